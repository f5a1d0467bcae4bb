"""Loads of the wheels of either side in a predicted pass: half of the axle's load, and half of their difference."""

from __future__ import annotations

import numpy as np

from sysid.arrays import DrawsByParameters, SamplesByAxlesBySets
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.rolling_runs import PlanarRuns, RollingRuns
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.side_signals import STEP_S
from sysid.prediction.measures import quantiles
from sysid.prediction.predicted_passes import WheelLoads
from sysid.prediction.quantiles import Quantiles
from sysid.prediction.vehicle_draws import VehicleDraws, vehicle_of
from sysid.vehicle_model.engine import Timing
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import EffectiveRoads, Pass, make_pass_batch


def rolling_pass(
    parameters: ParameterSet,
    roads: EffectiveRoads,
    driven: Pass,
    motion: Motion,
    timing: Timing,
    sets: DrawsByParameters,
    vehicles: VehicleDraws,
) -> RollingRuns | None:
    """The mean truck of all draws as it rolls; None where the fit knows nothing of roll, or the bump has no sides.

    Its road is raised by what tires of unlike sides make of the mean, `rise` of its `planar` runs.

    Parameters
    ----------
    driven, motion : the pass, with speed [m/s] and start [s] (1, 1); `timing` of its samples.
    sets : (n, p) log parameters; vehicles : of the n draws.
    """
    masses = vehicles.allowances.masses
    if not masses.sides.any() or roads.profiles[driven.bump].sides is None:
        return None
    middle = vehicles.amounts.mean(axis=0)
    typical, cases = masses.applied(vehicles.allowances.split(middle)[0])
    batch = make_pass_batch(roads.vehicle, roads.load_cases, roads, [driven], [])
    matrices, laws = vehicle_of(batch, parameters, vehicles.allowances, driven, middle)
    stride = max(1, int(STEP_S / timing.interval_s))
    planar = PlanarRuns(
        passes=[driven],
        rows=np.array([0]),
        felt=EffectiveRoads(typical, cases, roads.profiles, roads.contact, roads.tires),
        tracks=roads,
        matrices=matrices,
        road=vehicles.allowances.road([driven], middle),
        laws=laws,
        axle_x=batch.axle_x,
        motion=RunMotion.steady(np.asarray(motion.speed)[:, 0], np.asarray(motion.start_s)[:, 0]),
        timing=Timing(-(-timing.samples // stride) + 1, stride * timing.interval_s, stride),
        sides=masses.side_amounts(vehicles.allowances.split(middle)[0]),
    )
    typical_set = np.median(sets, axis=0)
    return RollingRuns(RollingRuns(planar, typical_set).raised(), typical_set)


def wheel_loads(
    runs: RollingRuns,
    interval_s: float,
    vehicles: VehicleDraws,
    tire_N: SamplesByAxlesBySets,
    static_N: np.ndarray,
) -> WheelLoads:
    """Loads of left and right wheels.

        F_left,right = (F +- D) / 2,    D = D_0 + sum_j dD/du_j (u_j - u_0j) + 2 e F,    0 <= F_left,right <= F

    with the axle's load F of a draw, the difference D_0 of the mean truck of all draws as it rolls, and the unknowns u
    of left and right and the error e of the draw. How D changes with the other parameters is left out.

    Parameters
    ----------
    runs : the mean truck of all draws; interval_s : of the samples [s].
    vehicles : of the n draws.
    tire_N : (T, na, n) F [N]; static_N : (na, n) at rest [N].
    """
    samples, masses, middle = len(tire_N), vehicles.allowances.masses, vehicles.amounts.mean(axis=0)
    unknowns = masses.side_unknowns
    off = vehicles.allowances.split((vehicles.amounts - middle).T)[0][masses.sides]
    at_rest = runs.rest_difference()[:, None] + runs.rest_difference_columns(unknowns) @ off
    moving = runs.load_difference()[:, :, 0, None] + runs.load_difference_columns(unknowns)[:, :, 0] @ off
    time = interval_s * np.arange(samples)
    grid = runs.step_s * np.arange(len(moving))
    error = 2.0 * (np.zeros_like(static_N) if vehicles.share_error is None else vehicles.share_error.T)
    at_rest = at_rest + error * static_N
    left = np.empty_like(tire_N)
    for i in range(tire_N.shape[1]):
        for draw in range(tire_N.shape[2]):
            force = tire_N[:, i, draw]
            apart = at_rest[i, draw] + np.interp(time, grid, moving[:, i, draw])
            apart += error[i, draw] * (force - static_N[i, draw])
            left[:, i, draw] = np.clip(0.5 * (force + apart), 0.0, force)
    sides = (left, tire_N - left)
    rest = [0.5 * (static_N + sign * at_rest) for sign in (1.0, -1.0)]
    return WheelLoads(
        _of_sides([quantiles(values) for values in rest]),
        _of_sides([quantiles(values.max(axis=0)) for values in sides]),
        _of_sides([_turned(quantiles(values)) for values in sides]),
    )


def _turned(found: Quantiles) -> Quantiles:
    low, high = (None if q is None else q.T for q in (found.q05, found.q95))
    return Quantiles(low, found.q50.T, high)


def _of_sides(found: list[Quantiles]) -> Quantiles:
    """Quantiles of left and right in one."""
    left, right = found
    low = None if left.q05 is None or right.q05 is None else np.stack([left.q05, right.q05])
    high = None if left.q95 is None or right.q95 is None else np.stack([left.q95, right.q95])
    return Quantiles(low, np.stack([left.q50, right.q50]), high)
