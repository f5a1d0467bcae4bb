"""Loads of left and right wheels in runs: derivatives, statics, and which side comes first."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from turned_bump import MOTION, RIGHT, made

from sysid.campaign.wheel_places import across_axle
from sysid.estimation.residuals.rolling_runs import PlanarRuns, RollingRuns
from sysid.estimation.residuals.side_unknowns import CG_SIDE, LEVER, SKEW, side_unknowns
from sysid.vehicle_model.engine import Timing


def rolling(sides: Mapping[tuple, float] | None = None, samples: int = 600) -> RollingRuns:
    _, model, x = made(RIGHT)
    arrays = model.arrays[0]
    planar = PlanarRuns(
        passes=model.passes[0],
        rows=np.arange(len(model.passes[0])),
        felt=model.felt,
        matrices=arrays.matrices,
        road=model.roads[0],
        laws=arrays.laws,
        axle_x=arrays.axle_x,
        motion=MOTION,
        timing=Timing(samples, 0.0025, 1),
        sides=tuple((sides or {}).items()),
    )
    return RollingRuns(planar, x)


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
