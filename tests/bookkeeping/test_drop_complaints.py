"""Drops against each other and against the runs, load case by load case."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from half_car import HalfCar, write_campaign

from sysid.bookkeeping import drop_cases, drops
from sysid.bookkeeping.drops import compressions, drop_complaints
from sysid.bookkeeping.force_balance import run_spectra
from sysid.campaign import read_campaign
from sysid.campaign.quality.check import check_quality

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
#: Suspensions of the empty truck [N/m]; those of the two air axles are three times as stiff in the laden one.
EMPTY = np.array([4e5, 3e5, 3e5, 1.1e6, 1.1e6, 1.1e6])
LADEN = EMPTY * np.array([1.0, 3.0, 3.0, 1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def truck():
    return read_campaign(DATA)


def said(truck, listed, monkeypatch, *, driven=("unloaded", "loaded")) -> list[str]:
    """Complaints about drops (axle, load case, factor on the compression that is right for it)."""
    right = {"unloaded": compressions(truck.vehicle, EMPTY), "loaded": compressions(truck.vehicle, LADEN)}
    first = truck.plank_drops[0]
    made, shares = [], {}
    for number, (axle, case, factor) in enumerate(listed):
        log = replace(first.log, file=f"drop{number}.csv")
        made.append(replace(first, axle=axle, load_case=case, log=log))
        shares[log.file] = factor * right[case][axle]

    def stiffness(spectra, campaign, name):
        of_case = {"unloaded": EMPTY, "loaded": LADEN}[name]
        return SimpleNamespace(unexplained=0.05, stiffness=of_case) if name in driven else None

    monkeypatch.setattr(drops, "compressed_share", lambda drop: shares[drop.log.file])
    monkeypatch.setattr(drops, "stiffness_of", stiffness)
    return drop_complaints(replace(truck, plank_drops=tuple(made)), [])


def test_an_air_spring_that_is_stiffer_under_load_is_not_odd(truck, monkeypatch):
    listed = [*((1, "unloaded", 1.0),) * 3, (1, "loaded", 1.0)]
    apart = compressions(truck.vehicle, EMPTY)[1] - compressions(truck.vehicle, LADEN)[1]
    assert apart > drops.REPEATS
    assert said(truck, listed, monkeypatch) == []


def test_a_drop_of_another_axle_is_odd_within_its_load_case(truck, monkeypatch):
    listed = [(1, "loaded", 1.0), *((1, "unloaded", 1.0),) * 3, (1, "unloaded", 0.5)]
    (sentence,) = said(truck, listed, monkeypatch)
    assert sentence.startswith("drop4.csv: its suspension is compressed by")


def test_runs_of_another_load_case_tell_nothing_of_springs_that_depend_on_the_load(truck, monkeypatch):
    listed = [(0, "unloaded", 1.6), (3, "unloaded", 1.6)]
    assert "times as high as listed" in said(truck, listed, monkeypatch)[0]
    assert said(truck, listed, monkeypatch, driven=("loaded",)) == []
    leaves = tuple(replace(axle, load_dependent=False) for axle in truck.vehicle.axles)
    without = replace(truck, vehicle=replace(truck.vehicle, axles=leaves))
    assert "times as high as listed" in said(without, listed, monkeypatch, driven=("loaded",))[0]


@pytest.mark.parametrize("axles", [{3, 4, 5}, {4}])
def test_drops_listed_under_another_load_case_are_named(truck, axles) -> None:
    """The trailer of the laden truck is some five times as heavy: no axle has fifteen times the k of its runs."""
    screened, _ = check_quality(truck)
    spectra = [s for run in screened.bump_runs if (s := run_spectra(run, truck.vehicle)) is not None]
    assert drop_complaints(screened, spectra) == []
    moved = tuple(replace(d, load_case="loaded") if d.axle in axles else d for d in screened.plank_drops)
    (sentence,) = drop_complaints(replace(screened, plank_drops=moved), spectra)
    assert "are listed under the load case 'loaded', but ring as with the masses of 'unloaded'" in sentence
    for axle in axles:
        assert f"'{truck.vehicle.axles[axle].name}'" in sentence
    assert f"plank_drops/axle{min(axles) + 1}_drop1.csv" in sentence


def test_a_drop_with_a_gap_in_its_decay_tells_no_frequency(truck) -> None:
    drop = next(d for d in truck.plank_drops if d.axle == 3)
    known = drop_cases._frequency_hz(drop)
    assert known is not None
    assert 2.0 < known < 3.4

    def lose(c):
        kept = (c.time_s < 2.0) | (c.time_s > 2.3)
        return replace(c, time_s=c.time_s[kept], value=c.value[kept], censored=c.censored[kept])

    assert (
        drop_cases._frequency_hz(replace(drop, log=replace(drop.log, channels=tuple(map(lose, drop.log.channels)))))
        is None
    )


@pytest.fixture(scope="module")
def half_car(tmp_path_factory):
    """Drops of a half car moved by its own equations, and a load case that is 1.86 times as heavy."""
    car = HalfCar(friction=(100.0, 100.0))
    campaign = read_campaign(write_campaign(tmp_path_factory.mktemp("half_car"), car))
    empty = campaign.load_cases["empty"]
    heavier = tuple(1.86 * (a - u) + u for a, u in zip(empty.axle_loads_kg, car.unsprung, strict=True))
    laden = replace(
        empty,
        name="laden",
        axle_loads_kg=heavier,
        sprung_mass_kg=(1.86 * car.mass,),
        pitch_inertia_kg_m2=(1.86 * car.inertia,),
    )
    drops_of = tuple(replace(d, release="plank", plank_height_m=0.075, lifted=()) for d in campaign.plank_drops)
    return replace(campaign, load_cases={"empty": empty, "laden": laden}, plank_drops=drops_of)


def of_modes(campaign, listed: str = "empty", springs: float | np.ndarray = 1.0) -> dict[str, str]:
    """Complaints about drops that are listed under a load case, where runs show springs times a factor."""
    car = HalfCar()
    found = SimpleNamespace(
        unexplained=0.05, stiffness=springs * np.array(car.stiffness), damping=springs**0.5 * np.array(car.damping)
    )
    moved = tuple(replace(d, load_case=listed) for d in campaign.plank_drops)
    return drop_cases.load_case_complaints(
        replace(campaign, plank_drops=moved), dict.fromkeys(campaign.load_cases, found)
    )


def test_all_drops_listed_under_another_load_are_named_by_their_modes(half_car) -> None:
    """The k of the drops would be 690 kN/m where the runs say 370: neighbours and pitch are in the modes."""
    assert of_modes(half_car) == {}
    sentence = of_modes(half_car, listed="laden")["laden"]
    assert (
        "'front' and 'rear' are listed under the load case 'laden', but ring as with the masses of 'empty'" in sentence
    )
    assert "Correct load_case in tests.plank_drop" in sentence


@pytest.mark.parametrize(("springs", "factor"), [(0.5, "2"), (1.7, "0.6")])
def test_no_axle_has_two_stiffnesses_under_one_load(half_car, springs: float, factor: str) -> None:
    alone = replace(half_car, load_cases={"empty": half_car.load_cases["empty"]})
    sentence = of_modes(alone, springs=springs)["empty"]
    assert f"springs {factor} times as stiff as those that the bump runs show" in sentence
    assert of_modes(alone, springs=1.15) == {}


@pytest.mark.parametrize(("springs", "named"), [((1.0, 1.0), False), ((0.5, 1.0), False), ((0.5, 0.5), True)])
def test_one_axle_speaks_for_no_other(half_car, springs: tuple[float, float], named: bool) -> None:
    """Friction of one axle looks like softer springs there, and only there."""
    alone = replace(half_car, load_cases={"empty": half_car.load_cases["empty"]})
    assert (of_modes(alone, springs=np.array(springs)) != {}) == named


def test_drops_of_a_single_axle_tell_no_factor(half_car) -> None:
    rear = tuple(d for d in half_car.plank_drops if d.axle == 1)
    alone = replace(half_car, load_cases={"empty": half_car.load_cases["empty"]}, plank_drops=rear)
    assert {d.axle for d in half_car.plank_drops} == {0, 1}
    assert of_modes(alone, springs=0.5) == {}


def test_a_repeat_of_another_truck_is_odd(half_car, tmp_path) -> None:
    """The third drop was made with a body of 0.4 times the mass: its k would be 2.5 times that of the others."""
    car = HalfCar(friction=(100.0, 100.0))
    lighter = replace(car, mass=0.4 * car.mass, inertia=0.4 * car.inertia)
    other = read_campaign(write_campaign(tmp_path, lighter, repeats=1)).plank_drops[-1]
    odd = replace(other, release="plank", load_case="empty", lifted=(), log=replace(other.log, file="odd.csv"))
    found = SimpleNamespace(stiffness=np.array(car.stiffness), damping=np.array(car.damping))
    told = {"empty": found}
    assert drop_cases.odd_repeats(half_car, told) == []
    (sentence,) = drop_cases.odd_repeats(replace(half_car, plank_drops=(*half_car.plank_drops, odd)), told)
    assert sentence.startswith("odd.csv rings unlike the other drops of 'rear'")


@pytest.mark.parametrize(("noise_m", "moved_m", "odd"), [(3e-4, 0.0, False), (0.0, 3e-4, False), (0.0, 2e-2, True)])
def test_a_suspension_that_friction_holds_is_not_odd(half_car, noise_m: float, moved_m: float, odd: bool) -> None:
    """Of its fall it shows noise, or a little creep; as much motion as the others show, in no mode, is odd."""
    drop = half_car.plank_drops[-1]
    rng = np.random.default_rng(5)

    def held(c):
        if c.sensor.kind != "suspension_deflection":
            return c
        still = 0.01 * c.value + noise_m * rng.normal(size=c.value.size)
        shaken = moved_m * rng.normal(size=c.value.size) * (c.time_s < c.time_s[-1] - 0.8)
        return replace(c, value=still + shaken)

    log = replace(drop.log, file="held.csv", channels=tuple(map(held, drop.log.channels)))
    car = HalfCar(friction=(100.0, 100.0))
    told = {"empty": SimpleNamespace(stiffness=np.array(car.stiffness), damping=np.array(car.damping))}
    said = drop_cases.odd_repeats(replace(half_car, plank_drops=(*half_car.plank_drops, replace(drop, log=log))), told)
    assert [s.startswith("held.csv") for s in said] == [True] * odd


@pytest.mark.parametrize(("seed", "moved_m", "odd"), [(0, 2.5e-4, False), (4, 2.5e-4, False), (1, 4e-3, True)])
def test_creep_within_the_noise_is_not_odd_beside_repeats_that_are_held(half_car, seed, moved_m, odd) -> None:
    """All repeats are held by friction and show noise of 0.25 mm; one of them moves besides, in no mode."""
    drop = half_car.plank_drops[-1]
    rng = np.random.default_rng(seed)

    def held(number: int):
        def readings(c):
            away = moved_m * (number == 0) * np.sin(2.0 * np.pi * 9.0 * c.time_s) * (c.time_s < c.time_s[-1] - 0.8)
            fallen = 0.02 * (c.time_s < 0.4)
            return replace(c, value=fallen + away + 2.5e-4 * rng.normal(size=c.value.size))

        channels = tuple(readings(c) if c.sensor.kind == "suspension_deflection" else c for c in drop.log.channels)
        return replace(drop, log=replace(drop.log, file=f"held{number}.csv", channels=channels))

    car = HalfCar()
    told = {"empty": SimpleNamespace(stiffness=np.array(car.stiffness), damping=np.array(car.damping))}
    said = drop_cases.odd_repeats(replace(half_car, plank_drops=tuple(map(held, range(3)))), told)
    assert [s.startswith("held0.csv") for s in said] == [True] * odd
