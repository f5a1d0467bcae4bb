"""How the cost of a likelihood grows with sets, runs, samples and axles, and that of derivatives with parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jax.tree_util import Partial

from benchmarks.rounds import Contender, run_rounds, spread, timed
from benchmarks.work import Point, Work, density, engine, make_work
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals import signals
from sysid.estimation.residuals.bump_model import GroupShape
from sysid.estimation.residuals.set_misfits import GroupInputs, group_misfits
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.engine import wheel_road
from sysid.vehicle_model.engines.protocol import Unknowns
from sysid.vehicle_model.stacked_matrices import StackedMatrices

SIZES = {
    "sets": (8, 32, 128, 512),
    "runs": (1, 2, 4, 8),
    "samples": (1, 2, 4, 8),
    "axles": (3, 6, 12, 24),
    "parameters": (6, 12, 24, 48),
}
SETS = 64


def measure_growth(point: Point, rounds: int, limit_s: float) -> dict[str, dict[str, object]]:
    """Sizes, seconds and exponent of seconds = constant * size^exponent for each direction of growth."""
    one = make_work(point, [0])
    parts = {
        "sets": lambda n: _likelihood(one, n),
        "runs": lambda n: _likelihood(make_work(point, [0] * n), SETS),
        "samples": lambda n: _of_group(one, *_more_samples(*_group(one), n)),
        "axles": lambda n: _of_group(one, *_more_axles(*_group(one), n)),
        "parameters": lambda n: _derivatives(one, n),
    }
    contenders = {
        (what, size): Contender(f"{what} {size}", timed(make(size)))
        for what, make in parts.items()
        for size in SIZES[what]
    }
    run_rounds(list(contenders.values()), rounds, limit_s)
    unit = {"samples": one.model.shapes[0].samples}
    found: dict[str, dict[str, object]] = {}
    for what, sizes in SIZES.items():
        samples = [contenders[what, size].per_unit("processor_s") for size in sizes]
        seconds = [spread(list(s.values())) for s in samples]
        slopes = [_exponent(sizes, [s[number] for s in samples]) for number in samples[0]]
        found[what] = {
            "size": [size * unit.get(what, 1) for size in sizes],
            "processor_s": seconds,
            "exponent": spread(slopes),
        }
    return found


def _exponent(sizes: tuple[int, ...], seconds: list[float]) -> float:
    """Slope of the logarithms, by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def _likelihood(work: Work, sets: int) -> Callable[[], object]:
    ours, points = density(work, "native"), work.sets(sets)
    ours(points)
    return lambda: ours(points)


def _group(work: Work) -> tuple[GroupInputs, GroupShape]:
    return density(work, "native")._inputs[0], work.model.shapes[0]


def _of_group(work: Work, inputs: GroupInputs, shape: GroupShape) -> Callable[[], object]:
    sets = work.sets(SETS).T

    def call() -> object:
        return group_misfits(inputs, sets, shape=shape)[0]

    call()
    return call


def _derivatives(work: Work, count: int) -> Callable[[], object]:
    """Residuals with their derivatives in `count` directions: by the parameters in turn, and from the first again."""
    point, shape = work.state.point, work.model.shapes[0]
    arrays = point.weights.on(work.model.arrays, 0)
    x = np.asarray(point.log_parameters)
    directions = np.eye(x.size)[:, np.arange(count) % x.size]
    of_motion = point.motion.per_unit(arrays.axle_x, arrays.change_unit)
    still = of_motion._make(np.zeros((columns.shape[0], count)) for columns in of_motion)
    readings = arrays.readings(point.weights.noise_sd[0], point.weights.tempering[0])
    with engine("native"):
        road = signals.wheel_road(arrays, work.model.roads[0], point.motion, shape)

    unknowns, laws = Unknowns(x, directions, still), Partial(axle_laws, arrays.laws)
    of_shape = shape.timing, shape.sensors, shape.recursion

    def call() -> object:
        return road.engine.linearise(arrays.matrices, laws, unknowns, road, *of_shape, readings)

    call()
    return call


def _more_samples(inputs: GroupInputs, shape: GroupShape, factor: int) -> tuple[GroupInputs, GroupShape]:
    """The same passage sampled `factor` times as often, with as many steps per sample."""
    arrays = inputs.arrays

    def often(values: np.ndarray) -> np.ndarray:
        return np.repeat(values, factor, axis=0)

    dense = arrays._replace(value=often(arrays.value), measured=often(arrays.measured), censored=often(arrays.censored))
    changed = shape._replace(interval_s=shape.interval_s / factor, samples=shape.samples * factor)
    return inputs._replace(
        arrays=dense, columns=inputs.columns._replace(residual=often(inputs.columns.residual))
    ), changed


def _more_axles(inputs: GroupInputs, shape: GroupShape, count: int) -> tuple[GroupInputs, GroupShape]:
    """The same truck with its axles repeated until it has `count`; the sensors stay at the first ones."""
    arrays = inputs.arrays
    now = arrays.axle_x.shape[0]
    index = np.arange(count) % now
    bodies = arrays.matrices.body_rows.shape[2]
    rows = np.concatenate([index, now + index, 2 * now + np.arange(bodies)])
    columns = np.concatenate([index, now + index])
    m, laws, road = arrays.matrices, arrays.laws, inputs.road.prepared.road
    matrices = StackedMatrices(
        m.position[:, rows],
        m.rate[:, rows],
        # Every wheel carries its share, so that the truck stays as stiff as it is.
        m.acceleration[:, :, columns] * now / count,
        *(value[:, index] for value in (m.inverse_unsprung, m.static_load, m.carried_load)),
        m.body_rows,
    )
    moved = laws._replace(
        **{name: getattr(laws, name)[index] for name in ("damping", "tire_stiffness", "tire_damping")},
        **{
            name: getattr(laws, name)[:, index]
            for name in ("stiffness", "static_load", "reference_load", "carried_load", "tire_factor", "tire_growth")
        },
    )
    stretched = EffectiveRoad(
        road.rise[:, index], road.first_station_m, road.step_m, road.stretch[:, :, index], road.drag[:, :, index]
    )
    axle_x = arrays.axle_x[index]
    with engine("native"):
        course = wheel_road(matrices, stretched, axle_x, inputs.road.motion, shape.timing)
    seen = shape._replace(
        deflection_axles=tuple(i % count for i in shape.deflection_axles),
        acceleration_axles=tuple(i % count for i in shape.acceleration_axles),
    )
    return inputs._replace(arrays=arrays._replace(matrices=matrices, laws=moved, axle_x=axle_x), road=course), seen
