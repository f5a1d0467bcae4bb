"""Loads of left and right wheels in runs: derivatives, statics, and which side comes first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from turned_bump import MOTION, RIGHT, made

from sysid.campaign.wheel_places import across_axle
from sysid.estimation.residuals.rolling_runs import PlanarRuns, RollingRuns
from sysid.estimation.residuals.side_unknowns import CG_SIDE, LEVER, SKEW, SPRING_SIDE, TIRE_SIDE, side_unknowns
from sysid.vehicle_model.engine import Timing

#: The turn of the bump as an unknown of left and right.
TURNED = (SKEW, 0, None, "bump")


def rolling(sides: Mapping[tuple, float] | None = None, x: np.ndarray | None = None) -> RollingRuns:
    _, model, given = made(RIGHT)
    arrays = model.arrays[0]
    planar = PlanarRuns(
        passes=model.passes[0],
        rows=np.arange(len(model.passes[0])),
        felt=model.felt,
        tracks=model.felt,
        matrices=arrays.matrices,
        road=model.roads[0],
        laws=arrays.laws,
        axle_x=arrays.axle_x,
        motion=MOTION,
        timing=Timing(600, 0.0025, 1),
        sides=tuple((sides or {}).items()),
    )
    return RollingRuns(planar, given if x is None else x)


def test_derivatives_are_differences_of_the_loads() -> None:
    data, model, _ = made(RIGHT)
    unknowns = side_unknowns(data, model.felt)
    runs = rolling()
    base, columns = runs.load_difference(), runs.load_difference_columns(unknowns)
    seen = set()
    for k, u in enumerate(unknowns):
        step = 2e-3 * u.sd
        there = rolling({(u.kind, u.place, u.load_case, u.of): step}).load_difference()
        difference = (there - base) / step
        size = float(np.abs(difference).max())
        assert np.abs(columns[..., k] - difference).max() <= (0.03 if u.kind == SKEW else 0.02) * size, u.name
        seen |= {u.kind} if size > 0.0 else set()
    # No sensor's place moves a load; all else does.
    assert seen == {u.kind for u in unknowns} - {LEVER}


def test_statics_of_a_load_to_one_side() -> None:
    """Moments about the middle of the truck: tires of both sides hold the body's weight where it stands."""
    data, model, _ = made(RIGHT)
    case = model.passes[0][0].load_case
    runs = rolling({(CG_SIDE, 0, case, None): 0.04})
    system, half = runs.system, np.array([0.5 * across_axle(a).track_m for a in model.felt.vehicle.axles])
    # Twin tires: the outer ones hold more.
    lever = system.square_track_m2 / half
    weight = model.felt.load_cases[case].sprung_mass_kg[0] * model.felt.vehicle.gravity_m_s2
    found = runs.rest_difference()
    assert np.all(found > 0.0)
    assert float(lever @ found) == pytest.approx(0.04 * weight, rel=1e-9)
    unknowns = side_unknowns(data, model.felt)
    of_place = [j for j, u in enumerate(unknowns) if u.kind == CG_SIDE and u.load_case == case]
    columns = runs.rest_difference_columns(unknowns)
    np.testing.assert_allclose(columns[:, of_place[0]], found / 0.04, rtol=1e-12)
    assert not np.any(np.delete(columns, of_place, axis=1))
    assert not np.any(rolling().rest_difference())


def test_the_side_that_meets_the_bump_first_is_loaded_first() -> None:
    """With the left wheels ahead of the right ones their load rises first, by twice the half track times the skew."""
    runs = rolling()
    difference = runs.load_difference()[:, 0, 0]
    first = np.flatnonzero(np.abs(difference) > 0.2 * np.abs(difference).max())[0]
    assert difference[first] > 0.0
    turned = rolling({(SKEW, 0, None, "bump"): -2.0 * np.tan(np.radians(2.0))}).load_difference()[:, 0, 0]
    first = np.flatnonzero(np.abs(turned) > 0.2 * np.abs(turned).max())[0]
    assert turned[first] < 0.0


def test_the_mean_road_rises_as_far_as_both_sides_push_more() -> None:
    """Against a root of the equation of forces, instant by instant."""
    runs = rolling({(TIRE_SIDE, 0, None, None): 0.05, TURNED: 0.4})
    # Pressed in less far, so that one side leaves the road.
    pressed = runs._tires.deflection
    runs._tires = replace(runs._tires, deflection=pressed - 0.9 * pressed[0])
    tires, axles = runs._tires, runs.system.axles
    station = np.linspace(-1.0, 3.0, 4001)
    found = runs.rise(station)
    apart = 0.5 * tires.difference - tires.half_track_m[:, None] * tires.gain * runs.base.angle[:, axles, :, 0]
    one_sided = 0
    for run in range(found.shape[0]):
        for axle, more in ((0, 0.05), (1, 0.0)):
            u = tires.reference_deflection[axle]

            def force(e: float, u: float = u) -> float:
                return max(e / u, 0.0) ** tires.exponent

            for at in range(0, len(runs._station), 7):
                x, e, a = runs._station[at, axle, run], tires.deflection[at, axle, run], apart[at, axle, run]
                if not station[0] < x < station[-1]:
                    continue
                both = 0.5 * ((1.0 + more) * force(e + a) + (1.0 - more) * force(e - a))
                if both == 0.0:
                    continue
                true = brentq(lambda r, e=e, both=both: force(e + r) - both, -e, abs(a) + 1e-9 - min(e, 0.0))
                one_sided += min(e + a, e - a) < 0.0
                assert np.interp(x, station, found[run, axle]) == pytest.approx(true, abs=2e-5)
    assert one_sided > 5
    assert np.abs(found).max() > 2e-3


def test_over_the_raised_road_the_mean_carries_what_both_sides_do() -> None:
    _, model, x = made(RIGHT)
    # Without damping of the tires: the deflection of the mean is told from its whole force.
    x = np.where([name.startswith("ct_") for name in model.parameters.names], 0.0, x)
    level = rolling({TURNED: 0.4}, x)
    raised = RollingRuns(level.raised(), x)

    def off(runs: RollingRuns) -> float:
        """By how much the load of the planar motion differs from that of both sides, over its changes."""
        axles = runs.system.axles
        left, right = runs._tires.forces(slice(None), runs.base.angle[:, axles], runs.base.rate[:, axles])
        load = runs._load + (left + right)[0, :, :, 0]
        return float(np.sqrt(np.mean(((left + right)[..., 0] - load) ** 2)) / np.std(runs._load))

    assert off(raised) < 0.3 * off(level)


def test_derivatives_are_differences_of_the_rise() -> None:
    data, model, _ = made(RIGHT)
    unknowns, station = side_unknowns(data, model.felt), np.linspace(-1.0, 4.0, 501)
    turned = {TURNED: 0.4}
    runs = rolling(turned)
    moved = runs.roll(np.stack([runs.derivative(u) for u in unknowns], axis=-1))
    base, columns = runs.rise(station), runs.rise_columns(station, unknowns, moved)
    compared = set()
    for k, u in enumerate(unknowns):
        step, key = 5e-3 * u.sd, (u.kind, u.place, u.load_case, u.of)
        there = rolling(turned | {key: turned.get(key, 0.0) + step}).rise(station)
        difference = (there - base) / step
        size = float(np.abs(difference).max())
        # What unlike tires do by themselves, not by the roll, is left out.
        if size * u.sd > 1e-6 and u.kind != TIRE_SIDE:
            assert np.sqrt(np.mean((columns[k] - difference) ** 2)) < 0.1 * np.sqrt(np.mean(difference**2)), u.name
            compared.add(u.kind)
    assert {SKEW, CG_SIDE, SPRING_SIDE} <= compared
