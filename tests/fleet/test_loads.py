"""Axle loads of a population: only passes over the same bump are put together."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from sysid.fleet.loads import pass_words, population_loads
from sysid.fleet.members import Member
from sysid.fleet.outcome import RESULT_FILE

BUMP = {"name": "bump", "height_m": 0.08, "length_m": 1.2, "sha256": "a" * 64}
OTHER = BUMP | {"height_m": 0.05, "sha256": "b" * 64}
WATTS = {"name": "watts 100 mm x 3.7 m", "height_m": 0.1, "length_m": 3.68, "sha256": "c" * 64}


def entry(ratio: float, shape: Mapping[str, Any] | None, file: str = "predictions/laden_48kmh.csv") -> dict[str, Any]:
    """One prediction; of an earlier version where there is no shape."""
    quantiles = {"q05": 0.95 * ratio, "q50": ratio, "q95": 1.05 * ratio}
    kind = {"load_case": "laden", "speed_km_h": 48.0, "axle": 1, "peak_dynamic_load_ratio": quantiles, "file": file}
    return kind if shape is None else kind | {"shape": dict(shape)}


def fleet(folder: Path, trucks: Sequence[Sequence[dict[str, Any]]]) -> list[Member]:
    """One campaign of every truck with these predictions."""
    members = []
    for number, predictions in enumerate(trucks):
        output = folder / f"C{number}"
        output.mkdir()
        (output / RESULT_FILE).write_text(json.dumps({"predictions": predictions}), encoding="utf-8")
        members.append(Member(f"T{number}", f"C{number}", output))
    return members


def test_loads_over_two_bumps_are_two_populations(tmp_path: Path) -> None:
    """Both are named "bump" in their campaigns."""
    ratios = [1.50, 1.52, 1.54, 2.50, 2.53, 2.56]
    trucks = [[entry(r, BUMP if r < 2.0 else OTHER)] for r in ratios]
    loads, remarks = population_loads("truck", fleet(tmp_path, trucks))
    assert [(x.trucks, x.shape) for x in loads] == [(3, "bump"), (3, "bump (2)")]
    assert [x.q50 for x in loads] == pytest.approx([1.52, 2.53], rel=0.002)
    assert loads[0].q95 < 2.0 < loads[1].q05
    assert remarks == []
    assert pass_words(loads) == ["laden, 48 km/h, axle 1, bump", "laden, 48 km/h, axle 1, bump (2)"]
    assert pass_words(loads[:1]) == ["laden, 48 km/h, axle 1"]


def test_two_bumps_in_one_campaign_are_two_populations(tmp_path: Path) -> None:
    trucks = [[entry(1.5 + 0.01 * t, BUMP), entry(2.5 + 0.01 * t, WATTS)] for t in range(4)]
    loads, _ = population_loads("truck", fleet(tmp_path, trucks))
    assert [(x.trucks, x.shape) for x in loads] == [(4, "bump"), (4, WATTS["name"])]
    assert [x.q50 for x in loads] == pytest.approx([1.515, 2.515], rel=0.002)


def test_one_bump_by_two_names_is_one_population(tmp_path: Path) -> None:
    trucks = [[entry(1.5, BUMP | {"name": name})] for name in ("bump", "yard", "bump")]
    loads, _ = population_loads("truck", fleet(tmp_path, trucks))
    assert [(x.trucks, x.shape) for x in loads] == [(3, "bump")]


def test_the_last_campaign_of_a_truck_counts(tmp_path: Path) -> None:
    """In the order of the fleet file, pass by pass: what only an earlier campaign predicted counts too."""
    ratios = [(1.2, 1.50), (1.3, 1.52), (1.4, 1.54)]
    members = fleet(tmp_path, [[entry(r, BUMP)] for pair in ratios for r in pair])
    members = [Member(f"T{number // 2}", m.campaign, m.output) for number, m in enumerate(members)]
    (load,), _ = population_loads("truck", members)
    assert load.trucks == 3
    assert load.q50 == pytest.approx(1.52, rel=0.002)
    (other,), _ = population_loads("truck", [m for pair in zip(members[1::2], members[::2], strict=True) for m in pair])
    assert other.q50 == pytest.approx(1.3, rel=0.02)


def test_trucks_of_many_places_get_a_remark_in_place_of_loads(tmp_path: Path) -> None:
    trucks = [[entry(1.5, BUMP | {"sha256": f"{t:064x}"})] for t in range(4)]
    loads, (remark,) = population_loads("truck", fleet(tmp_path, trucks))
    assert loads == []
    assert remark.startswith("truck: no three trucks cross the same bump in 'laden' at 48 km/h")


def test_results_of_earlier_versions_are_counted_apart(tmp_path: Path) -> None:
    """Nothing says that their bump is that of the others; passes over a shape are known by their file."""
    old = [[entry(2.0, None), entry(3.0, None, "predictions/laden_48kmh_watts.csv")] for _ in range(3)]
    new = [[entry(1.5, BUMP)] for _ in range(3)]
    loads, (remark,) = population_loads("truck", fleet(tmp_path, [*old, *new]))
    assert [(x.trucks, x.shape) for x in loads] == [(3, None), (3, None), (3, "bump")]
    assert [x.q50 for x in loads] == pytest.approx([2.0, 3.0, 1.5], rel=1e-3)
    assert "results of 3 campaigns are of an earlier version" in remark
    assert pass_words(loads)[0] == "laden, 48 km/h, axle 1, bump not known"


def test_damaged_predictions_are_no_loads(tmp_path: Path) -> None:
    good = [[entry(1.5, BUMP)] for _ in range(3)]
    damaged: list[Any] = [[entry(9.0, BUMP), 3], [entry(9.0, BUMP) | {"shape": "bump"}], [entry(float("nan"), BUMP)]]
    (load,), _ = population_loads("truck", fleet(tmp_path, [*good, *damaged]))
    assert load.trucks == 3


def test_trucks_that_hardly_differ_have_narrow_loads(tmp_path: Path) -> None:
    """Exact readings of a spread of 0.1 %: the interval is the t distribution's, apart from the prior of the spread."""
    log = np.log(1.5) + 0.001 * np.array([norm.ppf((t + 0.5) / 40) for t in range(40)])
    trucks = []
    for value in np.exp(log):
        one = entry(float(value), BUMP)
        one["peak_dynamic_load_ratio"] = {"q05": float(value), "q50": float(value), "q95": float(value)}
        trucks.append([one])
    (load,), _ = population_loads("truck", fleet(tmp_path, trucks))
    width = np.log(load.q95 / load.q05)
    assert width == pytest.approx(2.0 * norm.ppf(0.95) * np.std(log, ddof=1) * np.sqrt(41 / 40), rel=0.1)
