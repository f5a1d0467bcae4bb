"""Air pressures at rest against declared loads: areas worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.bookkeeping.pressures import pressure_complaints
from sysid.campaign import read_campaign
from sysid.campaign.records import BumpRun, Channel, Log, Sensor

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
READ = read_campaign(DATA)
AIR = tuple(replace(a, suspension="air") for a in READ.vehicle.axles)
CAMPAIGN = replace(READ, vehicle=replace(READ.vehicle, axles=AIR))
CASES = list(CAMPAIGN.load_cases)
AXLE, AREA_M2 = 2, 0.085


def load_N(case: str, axle: int = AXLE) -> float:
    """What the axle load leaves for the suspension."""
    mass = CAMPAIGN.load_cases[case].axle_loads_kg[axle] - CAMPAIGN.vehicle.axles[axle].unsprung_mass_kg
    return mass * CAMPAIGN.vehicle.gravity_m_s2


def run(number: int, case: str, pressure_pa: float, unit: str = "bar", area: float | None = None) -> BumpRun:
    time = np.arange(400) * 0.005
    sensor = Sensor("p3", "air_pressure", unit, axle=AXLE, area_m2=area)
    value = pressure_pa * (1.0 + 0.2 * np.sin(9.0 * np.clip(time - 1.0, 0.0, None)))
    channel = Channel(sensor, time, value, np.zeros(time.size, np.int8))
    return BumpRun("case", case, 4.0, 1, Log(f"run{number}.csv", 0.005, (), auxiliary=(channel,)))


def said(runs, campaign=CAMPAIGN) -> list[str]:
    return pressure_complaints(replace(campaign, bump_runs=tuple(runs), plank_drops=()))


def healthy(unit="bar", area=None, offset_pa=0.0, factor=1.0):
    cases = [CASES[0]] * 3 + [CASES[1]] * 3
    return [run(i, case, factor * (load_N(case) / AREA_M2 + offset_pa), unit, area) for i, case in enumerate(cases)]


def test_the_loads_differ():
    assert load_N(CASES[1]) > 1.4 * load_N(CASES[0])


@pytest.mark.parametrize("area", [None, AREA_M2, 1.1 * AREA_M2])
@pytest.mark.parametrize("factor", [1.0, 0.93, 1.07])
def test_healthy_pressures_are_left_alone(area, factor):
    assert said(healthy(area=area, factor=factor)) == []


def test_a_log_of_another_load_case_is_named():
    runs = healthy()
    wrong = replace(runs[1], load_case=CASES[1])
    (sentence,) = said([runs[0], wrong, *runs[2:], run(9, CASES[0], load_N(CASES[0]) / AREA_M2)])
    assert sentence.startswith(f"run1.csv is listed in load case '{CASES[1]}'")
    assert f"shows the air pressures of '{CASES[0]}'" in sentence


@pytest.mark.parametrize("area", [None, AREA_M2])
def test_a_wrong_axle_load_is_named(area):
    case = CAMPAIGN.load_cases[CASES[1]]
    loads = list(case.axle_loads_kg)
    loads[AXLE] = 0.6 * loads[AXLE]
    sprung = list(case.sprung_mass_kg)
    sprung[-1] -= case.axle_loads_kg[AXLE] - loads[AXLE]
    changed = replace(case, axle_loads_kg=tuple(loads), sprung_mass_kg=tuple(sprung))
    wrong = replace(CAMPAIGN, load_cases={**CAMPAIGN.load_cases, CASES[1]: changed})
    (sentence,) = said(healthy(area=area), wrong)
    assert f"'{CASES[1]}'" in sentence
    assert "axle load" in sentence or "axle_loads_kg" in sentence


@pytest.mark.parametrize(("unit", "factor"), [("psi", 6894.757 / 1e5), ("MPa", 10.0), ("kPa", 0.01)])
def test_a_pressure_in_another_unit_is_named(unit, factor):
    """Numbers in bar, declared in another unit."""
    (sentence,) = said(healthy(unit=unit, factor=factor))
    assert "'p3' reads" in sentence
    assert "bar" in sentence or "unit or scale" in sentence


def test_leaves_beside_the_bellows_carry_their_share():
    leaves = replace(READ, vehicle=replace(READ.vehicle, axles=tuple(replace(a, suspension="leaf") for a in AIR)))
    runs = healthy(offset_pa=-2e5)
    assert said(runs, leaves) == []
    assert len(said(runs)) == 1


def test_an_absolute_pressure_is_named():
    (sentence,) = said(healthy(offset_pa=101_325.0))
    assert "absolute pressure" in sentence


def test_a_declared_area_that_is_wrong_in_every_load_case_is_named():
    (sentence,) = said(healthy(area=2.0 * AREA_M2))
    assert "area_m2" in sentence


def test_without_pressures_nothing_is_said():
    bare = [replace(r, log=replace(r.log, auxiliary=())) for r in healthy()]
    assert said(bare) == []
    empty = [run(i, case, 0.0) for i, case in enumerate(CASES)]
    assert said(empty) == []
