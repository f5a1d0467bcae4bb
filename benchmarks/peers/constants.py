"""One run as plain arrays: what every peer's right-hand side takes, and what their signals are compared with."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter

from benchmarks.work import Work, engine
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals.signals import simulate_group, wheel_road
from sysid.vehicle_model.contact import CELL_POLYNOMIAL
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.stacked_matrices import StackedMatrices


class RunConstants(NamedTuple):
    """Matrices of one run as in :class:`StackedMatrices`, laws (na,) of one parameter set, and its road.

    `table` (8, na, n): rise, alpha_1, alpha_2, alpha_3, lift, beta_0, beta_1, beta_2 as quintic B-spline coefficients.
    """

    position: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    inverse_unsprung: np.ndarray
    static_load: np.ndarray
    body_rows: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    rest: np.ndarray
    reference: np.ndarray
    reference_load: np.ndarray
    exponent: np.ndarray
    tire_damping: np.ndarray
    axle_x: np.ndarray
    table: np.ndarray
    polynomial: np.ndarray
    first_station: float
    step: float
    speed: float
    start: float


def run_constants(work: Work) -> list[RunConstants]:
    """Constants of every run of the first group at the work's point.

    Raises
    ------
    ValueError
        If the vehicle has more than linear suspensions of single axles: the peers have no equations for them.
    """
    arrays, road = work.model.arrays[0], work.model.roads[0]
    matrices: StackedMatrices = arrays.matrices
    suspension, tire = axle_laws(arrays.laws, jnp.asarray(work.state.point.log_parameters)[:, None])
    if matrices.beams is not None or any(value is not None for value in suspension[2:]) or road.stretch is None:
        raise ValueError("the peers know linear suspensions of single axles and the footprint contact only")
    runs = list(work.model.groups[0].runs)
    table = np.concatenate([road.rise[None], road.stretch, road.drag])
    shape = tire.static_deflection.shape[:2]

    def law(value: object, r: int) -> np.ndarray:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(value), (*shape, 1))[r, :, 0])

    return [
        RunConstants(
            *(np.ascontiguousarray(m[r]) for m in matrices[:3]),
            np.ascontiguousarray(matrices.inverse_unsprung[r, :, 0]),
            np.ascontiguousarray(matrices.static_load[r, :, 0]),
            np.ascontiguousarray(matrices.body_rows[r]),
            law(suspension.stiffness, r),
            law(suspension.damping, r),
            law(tire.static_deflection, r),
            law(tire.reference_deflection, r),
            law(tire.reference_load, r),
            law(tire.exponent, r),
            law(tire.damping, r),
            np.ascontiguousarray(arrays.axle_x[:, 0]),
            np.ascontiguousarray(table[:, r]),
            CELL_POLYNOMIAL,
            road.first_station_m,
            road.step_m,
            float(work.state.point.motion.speed_m_s[run]),
            float(work.state.point.motion.start_s[run]),
        )
        for r, run in enumerate(runs)
    ]


class Acquisition:
    """Samples and anti-alias filter of the first group, for solvers that know the unfiltered signals.

    The filter takes the signals as parabolas between points `1 / (2 substeps)` of a sample interval apart, as the
    product does; its poles are run over all channels, runs and sets at once.  Unfiltered signals are asked for at the
    sample times alone.
    """

    def __init__(self, work: Work, substeps: int | None = None, *, filtered: bool = True):
        shape = work.model.shapes[0]
        self.substeps = substeps or shape.substeps
        step_s = shape.interval_s / self.substeps
        self._filter = discretise(shape.filter, step_s) if filtered and shape.filter is not None else None
        points = 1 if self._filter is None else 2 * self.substeps
        self.times = np.arange(points * (shape.samples - 1) + 1) * (shape.interval_s / points)
        self.layout = shape.sensors

    def shown(self, signals: np.ndarray) -> np.ndarray:
        """Samples (T, ...) of signals at `times`."""
        f = self._filter
        if f is None:
            return signals
        now, middle = signals[::2], signals[1::2]
        shown = np.sum((f.weight * f.feed).real) * now
        for decay, start, half, weight in zip(f.decay, f.start, f.middle, f.weight, strict=True):
            memory = lfilter([1.0], [1.0, -decay], start * now[:-1] + half * middle, axis=0)
            shown[1:] += weight.real * memory.real - weight.imag * memory.imag
        return np.asarray(shown[:: self.substeps])


def our_signals(work: Work, name: str, refine: int = 1) -> np.ndarray:
    """Filtered signals (T, R, C) of the first group by one of our engines, with `refine` times as many steps."""
    arrays = work.model.arrays[0]
    shape = work.model.shapes[0]._replace(substeps=work.model.shapes[0].substeps * refine)
    runs = list(work.model.groups[0].runs)
    motion = work.state.point.motion.of(runs)
    parameters = jnp.asarray(work.state.point.log_parameters)[:, None]
    with engine(name):
        road = wheel_road(arrays, work.model.roads[0], motion, shape)
        signals = simulate_group(arrays, shape, parameters, road)
    return np.asarray(signals[..., 0])


def worst_error(signals: np.ndarray, reference: np.ndarray) -> float:
    """Relative RMS error of the worst channel of any run; arrays (T, R, C)."""
    error = np.sqrt(((signals - reference) ** 2).mean(axis=0))
    return float((error / np.sqrt((reference**2).mean(axis=0))).max())
