"""The study of pairs, one truck by bump and by drives: its physics by hand, its files, what its tables count."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent_motion import ROAD_BEGIN_M, ROAD_STEP_M, element_columns, element_force, on_road, rubber_rate
from independent_truck import THREE_AXLES, Elements

from studies.road_drives import pairs
from studies.road_drives.pairs_table import apart_sd, holds, overlap, tables, wrong_tables
from sysid.campaign.read import read_campaign


def test_a_second_leaf_carries_beyond_its_gap_only() -> None:
    each = (Elements(helper_N_per_m=2e5, helper_m=0.02),) * 3
    spring, *_ = element_force(replace(THREE_AXLES, elements=each), np.array(THREE_AXLES.stiffness))
    k = np.array(THREE_AXLES.stiffness)
    np.testing.assert_allclose(spring(np.full(3, -0.01)), -0.01 * k, rtol=1e-6)
    np.testing.assert_allclose(spring(np.full(3, -0.05)), -0.05 * k - 0.03 * 2e5, rtol=1e-6)


def test_rubber_delays_a_damper_by_its_softness_times_c() -> None:
    """At a constant rate v the force is c v (1 - exp(-t / (chi c)))."""
    chi, v, step = 1.0 / 3e6, 0.2, 4e-6
    truck = replace(THREE_AXLES, elements=(Elements(bushing_m_per_N=chi),) * 3)
    column, c = element_columns(truck), np.array(THREE_AXLES.damping)
    force, time = np.zeros(3), 0.0
    while time < 0.004:
        force, time = force + step * np.asarray(rubber_rate(column, force, v)), time + step
    np.testing.assert_allclose(force, c * v * (1.0 - np.exp(-time / (chi * c))), rtol=5e-3)
    assert not np.any(rubber_rate(element_columns(THREE_AXLES), force, v))


def test_roads_lie_where_stations_say() -> None:
    heights = np.array([0.1 * (ROAD_BEGIN_M + ROAD_STEP_M * np.arange(1000)) + k for k in (0.0, 2.0)])
    height, slope = on_road(heights)(np.array([[3.0, -4.02], [7.13, 0.0]]))
    np.testing.assert_allclose(height, [[0.3, -0.402], [2.713, 2.0]], atol=1e-6)
    np.testing.assert_allclose(slope, 0.1, rtol=1e-4)


def test_a_pair_is_written_as_a_campaign_with_and_without_the_bump(tmp_path: Path) -> None:
    truck, declared = pairs.trucks_of(8, 3, wrong=False)
    readings = tuple(0.01 * np.random.default_rng(n).normal(size=(3000, 12)) for n in range(5))
    pair = pairs.Pair(truck, declared, "of the model", (1.0,) * 5, readings)
    pairs.write_pair(tmp_path / "campaign", pair, np.random.default_rng(1))
    whole, drives = (read_campaign(tmp_path / "campaign" / f"{name}.toml") for name in ("whole", "drives"))
    assert [len(c.bump_runs) for c in (whole, drives)] == [3, 0]
    assert [len(c.road_drives) for c in (whole, drives)] == [2, 2]
    assert whole.load_cases["only"].axle_loads_kg == pytest.approx(declared.load_cases["only"][0])
    # What is declared is off by tolerances, and the true secant is that of the drawn damper.
    assert 0.0 < np.max(np.abs(np.array(declared.unsprung_kg) / truck.unsprung_kg - 1.0)) < 0.15
    knees = np.array([e.knee_m_per_s for e in truck.elements])
    assert truck.secant_damping() == pytest.approx(np.array(truck.damping) / (1.0 + 0.5 / knees))


def entry(quantity: str, bump: float, drives: float, sd: float = 0.02) -> dict:
    return {
        "name": {"stiffness": "k_1", "damping": "c_1"}[quantity],
        "quantity": quantity,
        "truth": 1.0,
        "bump": [bump, sd],
        "drives": [drives, sd],
    }


def record(
    *entries: dict, kinds: tuple[str, ...] = (), physics: str = "of the model", failed: str | None = None
) -> dict:
    trust = "do_not_bet" if kinds else "use_within"
    return {"physics": physics, "failed": failed, "entries": list(entries), "kinds": list(kinds), "trust": trust}


def test_the_tables_count_what_agrees_and_what_the_verdict_says() -> None:
    close, apart, far = (entry("stiffness", 1.0, v) for v in (1.01, 1.055, 1.2))
    assert apart_sd(close) == pytest.approx(np.log(1.01) / (0.02 * np.sqrt(2.0)))
    # 0.0535 is beyond 1.645 times 0.0283, and within 1.645 times 0.04.
    assert [overlap(e) for e in (close, apart, far)] == [True, True, False]
    assert [holds(e, "drives") for e in (close, apart, far)] == [True, False, False]
    shown = tables([record(close), record(close, apart), record(far, kinds=("balance_disagrees",)), record(failed="?")])
    assert "| k | 4 | 2 (50%) | 3 (75%) | 100%, 50% |" in shown
    assert "overlap in 2 of 3 pairs; all differences are within their 90 % in 1." in shown
    assert "disagrees in 1. Refused: 1." in shown
    bump = record(far, entry("damping", 0.9, 1.0), kinds=("balance_disagrees",), physics="helper")
    (row,) = (line for line in wrong_tables([bump]).splitlines() if "second leaf" in line)
    assert "| 1 | +0.0, +20.0 % | -10.0, +0.0 % | +6.4 (k_1) | 1 | 1 |" in row
