"""The study of independent trucks: kinds, forces of suspensions and masses by hand, what its tables count."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent_motion import INTERVAL_S, LENGTH_M, STEP_S, element_force, peak_ratios, rough_road, simulate
from independent_physics import KINDS, PASSES, declared_truck, true_truck
from independent_truck import GRAVITY, LOWBOY, THREE_AXLES, Elements, Equations
from scipy.stats import norm

from studies.independent import case
from studies.independent.table import holds, tables, write


def test_kinds_of_the_study_are_those_that_can_be_simulated() -> None:
    assert sorted(KINDS) == sorted(name for every in case.KINDS.values() for name in every)
    assert case.kind_of("7 % friction") == "friction"


def test_every_kind_comes_equally_often_for_both_vehicles() -> None:
    drawn = [case.draw(number) for number in range(case.EACH * len(case.KINDS))]
    for vehicle, each in (("three axles", 4), ("lowboy", 1)):
        counts = Counter(case.kind_of(physics) for v, physics in drawn if v == vehicle)
        assert counts == dict.fromkeys(case.KINDS, each)
    # All physics of a kind come too, and as often as each other to within one.
    for every in case.KINDS.values():
        times = [sum(physics == name for _, physics in drawn) for name in every]
        assert max(times) - min(times) <= 1
        assert min(times) > 0


def test_scales_of_a_kind_cover_all_equally_likely_errors() -> None:
    numbers = range(case.EACH * len(case.KINDS))
    errors = np.array([case.scale_error(number, 11) for number in numbers])
    of = np.array([case.kind_of(case.draw(number)[1]) for number in numbers])
    for kind in case.KINDS:
        parts = np.floor(case.EACH * norm.cdf(errors[of == kind]))
        assert sorted(parts) == list(range(case.EACH))
    # In another order for another kind, another seed and another table, and about as wide as they should be.
    first = {kind: tuple(errors[of == kind].argsort()) for kind in case.KINDS}
    assert len(set(first.values())) > len(case.KINDS) // 2
    assert case.scale_error(0, 12) != errors[0]
    assert case.scale_error(len(numbers), 11) != errors[0]
    assert 0.85 < errors.std() < 1.15


def test_a_scale_is_off_by_what_is_asked_for() -> None:
    declared = declared_truck("three axles", replace(KINDS["linear"], reading=0.0))
    for asked in (-2.0, 0.5):
        physics = replace(KINDS["linear"], reading=0.0)
        truck = true_truck(declared, physics, np.random.default_rng(3), asked)
        ratio = np.array(truck.load_cases["empty"][0]) / np.array(declared.load_cases["empty"][0])
        np.testing.assert_allclose(ratio, 1.0 + 0.005 * asked, rtol=1e-12)
        # All else is drawn as without it.
        other = true_truck(declared, physics, np.random.default_rng(3))
        assert truck.stiffness == other.stiffness
        assert truck.load_cases != other.load_cases


def test_forces_of_springs_dampers_and_stops() -> None:
    element = Elements(
        air=(2.5, 30.0), bump_ratio=0.6, rebound_ratio=1.4, knee_m_per_s=1.2, jounce_m=0.07, rebound_m=0.08
    )
    truck = replace(THREE_AXLES, elements=(element,) * 3)
    spring, other, share, _ = element_force(truck, np.array(truck.stiffness))
    assert not np.any(share)
    # Compressed by 30 mm: k q (1 + a q / 2 + b q^2 / 3) against the compression.
    q = 0.03
    expected = -np.array(truck.stiffness) * q * (1.0 + 2.5 * q / 2 + 30.0 * q**2 / 3)
    np.testing.assert_allclose(np.asarray(spring(np.full(3, -q))), expected, rtol=1e-6)
    # 0.4 m/s of compression, then of rebound.
    c = np.array(truck.damping) * 0.4 / (1.0 + 0.4 / 1.2)
    np.testing.assert_allclose(np.asarray(other(np.zeros(3), np.full(3, -0.4))), -0.6 * c, rtol=1e-6)
    np.testing.assert_allclose(np.asarray(other(np.zeros(3), np.full(3, 0.4))), 1.4 * c, rtol=1e-6)
    # 10 mm into a stop on either side: k_s d (1 + d / 15 mm).
    stop = 2.0e6 * 0.01 * (1.0 + 10.0 / 15.0)
    np.testing.assert_allclose(np.asarray(other(np.full(3, -0.08), np.zeros(3))), -stop, rtol=1e-5)
    np.testing.assert_allclose(np.asarray(other(np.full(3, 0.09), np.zeros(3))), stop, rtol=1e-5)


def test_secant_and_stiffness_under_load() -> None:
    truck = replace(THREE_AXLES, elements=(Elements(knee_m_per_s=0.5, bump_ratio=0.5, load_exponent=0.7),) * 3)
    # At half its knee a damper gives two thirds; compression 0.5 and rebound 1 average 0.75.
    np.testing.assert_allclose(truck.secant_damping(0.25), 0.5 * np.array(truck.damping))
    carried = [np.array(truck.load_cases[c][0]) - np.array(truck.unsprung_kg) for c in ("empty", "laden")]
    np.testing.assert_allclose(truck.stiffness_of("laden") / truck.stiffness, (carried[1] / carried[0]) ** 0.7)
    np.testing.assert_array_equal(truck.stiffness_of("empty"), truck.stiffness)


@pytest.mark.parametrize("kind", ["linear", "worn", "full rocker", "bends and rubs"])
@pytest.mark.parametrize("vehicle", ["three axles", "lowboy"])
def test_a_true_truck_stands_on_its_wheels(vehicle: str, kind: str) -> None:
    physics = KINDS[kind]
    declared = declared_truck(vehicle, physics)
    truck = true_truck(declared, physics, np.random.default_rng(3))
    for name, (loads, sprung, *_) in truck.load_cases.items():
        assert sum(loads) == pytest.approx(sum(sprung) + sum(truck.unsprung_kg))
        assert loads != declared.load_cases[name][0]
    assert truck.x_m == declared.x_m
    assert {e.friction_share > 0.0 for e, s in zip(truck.elements, truck.suspension, strict=True) if s == "air"} <= {
        False
    }
    assert {c for c, _ in PASSES} == set(truck.load_cases)


def test_true_peaks_are_not_missed_between_readings() -> None:
    speed = 48.0 / 3.6
    seconds = 2.5 + (THREE_AXLES.x_m[-1] + LENGTH_M) / speed
    run = ("empty", speed, 1.0, 0.0)
    force = simulate(THREE_AXLES, [run], seconds, interval_s=STEP_S)[:, 0, 3 * len(THREE_AXLES.x_m) :]
    static = np.array(THREE_AXLES.load_cases["empty"][0]) * GRAVITY
    # The top of the parabola through the largest value and its neighbours.
    top = force.argmax(axis=0)
    before, at, after = (force[top + k, range(force.shape[1])] for k in (-1, 0, 1))
    highest = at + (after - before) ** 2 / (8.0 * (2.0 * at - before - after))
    found = peak_ratios(THREE_AXLES, (("empty", 48.0),))[0]
    np.testing.assert_allclose(found, highest / static, rtol=1.5e-4)
    # Readings as far apart as those of a log miss it.
    coarse = force[:: round(INTERVAL_S / STEP_S)].max(axis=0)
    assert (coarse / highest).min() < 0.99


def test_a_rough_road_has_the_spectrum_that_it_says() -> None:
    height = rough_road(replace(LOWBOY, roughness_m3=4e-6), np.random.default_rng(1))
    s = np.arange(0.0, 2000.0, 0.05)
    h = np.concatenate([np.asarray(height(part)) for part in np.array_split(s, 40)])
    # Variance of 0.05 to 3 cycles per metre under Gd (n / 0.1)^-2: Gd 0.1^2 (1 / 0.05 - 1 / 3).
    assert np.var(h) == pytest.approx(4e-6 * 0.01 * (1 / 0.05 - 1 / 3), rel=0.03)


def _record(number: int, physics: str, *, hold: bool, linear: bool = True, laws: tuple[str, ...] = ()) -> dict:
    entry = [0.98, 1.0, 1.02] if hold else [0.88, 0.9, 0.92]
    entries = [{"kind": k, "truth": 1.0, "reported": entry} for k in ("stiffness", "damping", "peak")]
    return {
        "number": number, "vehicle": "lowboy", "physics": physics, "linear": linear, "failed": None, "laws": list(laws),
        "trust": "use_within", "entries": entries,
    }  # fmt: skip


def test_tables_count_what_holds(tmp_path: Path) -> None:
    records = [
        _record(0, "linear", hold=True, laws=("stops",)),
        _record(1, "worn", hold=False, linear=False, laws=("friction",)),
        _record(2, "linear", hold=False, laws=("friction",)),
        {
            "number": 3,
            "vehicle": "lowboy",
            "physics": "worn",
            "linear": False,
            "failed": "no",
            "code": 4,
            "entries": [],
        },
    ]
    assert holds(records[0]["entries"][0])
    assert not holds(records[1]["entries"][0])
    text = tables(records)
    assert "| k | 3 | 33 % | 2.2 % | 10.0 % | 10.0 % |" in text
    assert "| linear | 2 | 50 % | 1 of 2 | 1 of 2 | 1 of 2 | 10.0, 10.0, 10.0 % | use within: 2 |" in text
    assert "Laws that are not there: in 1 of 2 campaigns" in text
    assert "intervals hold in 2 of 3 campaigns. Not converged or refused: 1 of 4." in text
    page = tmp_path / "page.md"
    page.write_text("<!-- independent trucks: begin -->\n<!-- independent trucks: end -->\n", encoding="utf-8")
    write(records, 5, page)
    assert "4 campaigns of seed 5, 4 of them tractors" in page.read_text(encoding="utf-8")


def test_kinds_with_several_physics_are_shown_by_physics_too() -> None:
    records = [_record(0, "2 % friction", hold=True), _record(1, "7 % friction", hold=False)]
    lines = tables(records).splitlines()
    assert any(line.startswith("| friction | 2 | 50 % | 1 of 2 |") for line in lines)
    assert any(line.startswith("| 2 % friction | 1 | 100 % | 1 of 1 |") for line in lines)
    assert any(line.startswith("| 7 % friction | 1 | 0 % | 0 of 1 |") for line in lines)


def test_peaks_by_the_normal_stand_beside_those_of_the_same_pass_and_axle() -> None:
    result = {
        "predictions": [
            {
                "load_case": c,
                "speed_km_h": v,
                "axle": a,
                "peak_dynamic_load_ratio": {"q05": 1.0, "q50": 2.0, "q95": 3.0},
            }
            for c, v in (("empty", 48.0), ("laden", 32.0))
            for a in (1, 2)
        ]
    }
    normal = [[[10 * p + a + q / 10 for q in range(3)] for a in range(2)] for p in range(2)]
    found = case._peaks(result, {"peaks": [[2.1, 2.2], [2.3, 2.4]]}, normal)
    assert [e["truth"] for e in found] == [2.1, 2.2, 2.3, 2.4]
    np.testing.assert_allclose([e["normal"][1] for e in found], [0.1, 1.1, 10.1, 11.1])


def test_normal_approximation_stands_beside_the_sampled_intervals() -> None:
    result = {
        "parameters": [
            {
                "quantity": "damping",
                "axle": 1,
                "load_case": None,
                "posterior": {"q05": 0.95, "q50": 1.0, "q95": 1.05},
                "least_squares": {"value": 2.0, "sd": 0.04},
            }
        ]
    }
    entry = case._parameters(result, {"stiffness": {}, "damping": [1.0]})[0]
    # 2 exp(-+ 1.645 x 0.02).
    np.testing.assert_allclose(entry["normal"], [1.93527, 2.0, 2.06689], rtol=1e-5)
    record = _record(0, "linear", hold=True, laws=())
    record["entries"] = [{**e, "normal": entry["normal"]} for e in record["entries"]]
    # Their truth is not about 2: the sampled interval holds it, that of the normal does not.
    assert "| 0 %, 3.3 % |" in tables([record])


@pytest.mark.parametrize("kind", ["frame bends at 7 Hz", "frame bends at 12 Hz", "bends and rubs"])
@pytest.mark.parametrize("vehicle", ["three axles", "lowboy"])
def test_frames_that_bend_have_a_positive_modal_mass(vehicle: str, kind: str) -> None:
    for seed in range(5):
        truck = true_truck(declared_truck(vehicle, KINDS[kind]), KINDS[kind], np.random.default_rng(seed))
        last = truck.bodies - 1
        for loads, sprung, inertia, _ in truck.load_cases.values():
            cg, _ = Equations._statics(truck, np.array(loads), np.array(sprung))
            shape, modal_mass = Equations._shape(truck, last, sprung[last], inertia[last], cg[last])
            assert 0.0 < modal_mass < 4.0 * sprung[last]
            assert shape(0.5 * sum(truck.bending[last].ends_m)) < 0.0  # sags between ends that rise
