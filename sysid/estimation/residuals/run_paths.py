"""Paths of the wheels of bump runs over edges, about which the springs of their tires are followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.road.wheel_paths import WheelPaths
from sysid.vehicle_model.engine import Timing, wheel_road
from sysid.vehicle_model.passes import EDGES, MapTires, Pass
from sysid.vehicle_model.wheel_places import wheel_paths

#: How often the springs of runs that are not fitted are followed about the paths of the time before.
_ROUNDS = 4


def about_own_paths(
    model: BumpModel, log_parameters: Parameters, motion: RunMotion, made: Callable[[MapTires], BumpModel]
) -> BumpModel:
    """A model of runs that no search follows, about the paths of its wheels; the same over smooth bumps.

    Parameters
    ----------
    log_parameters, motion : (p,) and the runs' own motions.
    made : the model with other tires of its maps.
    """
    for _ in range(_ROUNDS):
        tires = with_run_paths(model.felt.tires, model, log_parameters, motion)
        if not tires.paths:
            break
        model = made(tires)
    return model


def with_run_paths(tires: MapTires, model: BumpModel, log_parameters: Parameters, motion: RunMotion) -> MapTires:
    """Tires of maps with the paths of all runs over bumps with edges, as a model simulates them.

    Parameters
    ----------
    log_parameters, motion : (p,) and the runs' own motions.
    """
    met = {(p.load_case, p.bump) for passes in model.passes for p in passes}
    harsh = {key for key in met if model.felt.off_springs(Pass(*key)) > EDGES}
    paths: dict[tuple[str, str, str], WheelPaths] = {}
    for position, passes in enumerate(model.passes):
        edged = [r for r, p in enumerate(passes) if (p.load_case, p.bump) in harsh]
        if not edged:
            continue
        arrays, shape = model.arrays[position], model.shapes[position]
        # Wheels rise at edges within a sample.
        timing = Timing(shape.samples * shape.substeps, shape.interval_s / shape.substeps, 1)
        along = motion.of(model.groups[position].runs).along_road(arrays.axle_x)
        road = wheel_road(arrays.matrices, model.roads[position], arrays.axle_x, along, timing)
        suspension, tire = axle_laws(arrays.laws, log_parameters[:, None])
        found = road.engine.histories(arrays.matrices, suspension, tire, road, timing)
        body, extension = (np.moveaxis(np.asarray(h)[..., 0], 1, 2) for h in (found.body, found.deflection))
        time = timing.interval_s * np.arange(timing.samples)
        place = np.asarray(along.travelled(time[:, None, None]))[:, None, :, 0] - arrays.axle_x
        all_runs = wheel_paths(arrays.matrices, suspension, body, extension, place)
        for r in edged:
            paths[passes[r].key] = WheelPaths(all_runs.station_m[:, :, r, None], all_runs.rise_m[:, :, r, None])
    return replace(tires, paths=paths)
