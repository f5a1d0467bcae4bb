"""The acquisition's analogue anti-alias filter as a recursion on the integration grid.

The filter's partial fractions H(s) = sum_k r_k / (s - p_k) are integrated exactly for an input that is quadratic over
each step (values at its start, middle and end). So the recursion has the magnitude and phase of the analogue filter up
to the Nyquist frequency of the half step.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from scipy import signal

from sysid.campaign.records import AntiAliasFilter


@dataclass(frozen=True)
class FilterRecursion:
    """Coefficients of x' = decay x + start u_n + middle u_(n+1/2);  y = Re(sum weight (x + feed u_n)).

    All arrays are complex of shape (poles,), one entry per real pole or complex-conjugate pair.  They follow from the
    analogue filter `spec` and the step that they are for, `step_s`: functions are compiled once for both of them.
    """

    spec: AntiAliasFilter
    step_s: float
    decay: np.ndarray = field(compare=False)
    start: np.ndarray = field(compare=False)
    middle: np.ndarray = field(compare=False)
    feed: np.ndarray = field(compare=False)
    weight: np.ndarray = field(compare=False)


def analogue_transfer(spec: AntiAliasFilter) -> tuple[np.ndarray, np.ndarray]:
    """Poles [rad/s] and residues of the analogue low-pass, unit gain at zero frequency."""
    corner = 2 * np.pi * spec.cutoff_hz
    if spec.kind == "butterworth":
        _, poles, gain = signal.butter(spec.order, corner, btype="low", analog=True, output="zpk")
    else:
        _, poles, gain = signal.bessel(spec.order, corner, btype="low", analog=True, output="zpk", norm="mag")
    # Residues from the distances of the poles: polynomial coefficients lose half of the digits at order 12.
    distance = poles[:, None] - poles
    np.fill_diagonal(distance, 1.0)
    return poles, gain / distance.prod(axis=1)


def discretise(spec: AntiAliasFilter, step_s: float) -> FilterRecursion:
    """Recursion of the analogue filter on a grid of `step_s` [s] with mid-step input values.

    With z = p h and I_j = int_0^1 exp(z (1 - s)) s^j ds, a quadratic input u_0, u_m, u_1 adds
    h [(I_0 - 3 I_1 + 2 I_2) u_0 + 4 (I_1 - I_2) u_m + (2 I_2 - I_1) u_1] to the state of the pole p.
    """
    poles, residues = analogue_transfer(spec)
    keep = poles.imag >= -1e-9 * np.abs(poles)
    poles, residues = poles[keep], residues[keep]
    weight = np.where(np.abs(poles.imag) > 1e-9 * np.abs(poles), 2.0, 1.0) * residues
    z = poles * step_s
    i0 = np.expm1(z) / z
    i1 = (i0 - 1.0) / z
    i2 = (2.0 * i1 - 1.0) / z
    decay = np.exp(z)
    end = step_s * (2.0 * i2 - i1)
    return FilterRecursion(
        spec=spec,
        step_s=step_s,
        decay=decay,
        start=step_s * (i0 - 3.0 * i1 + 2.0 * i2) + decay * end,
        middle=step_s * 4.0 * (i1 - i2),
        feed=end,
        weight=weight,
    )


def filter_memory(recursion: FilterRecursion | None, shape: tuple[int, ...]) -> jax.Array:
    """State (2, poles, *shape) of a filter that has seen zeros only, real and imaginary parts; no poles without one."""
    return jnp.zeros((2, 0 if recursion is None else recursion.decay.size, *shape))


def filtered(recursion: FilterRecursion, memory: jax.Array, now: jax.Array) -> jax.Array:
    """Output y of the filter whose state is `memory` at the start of a step, where its input is `now`."""
    direct = float(np.sum((recursion.weight * recursion.feed).real))
    shown = direct * now
    for k, weight in enumerate(recursion.weight):
        shown = shown + weight.real * memory[0, k] - weight.imag * memory[1, k]
    return shown


def next_memory(recursion: FilterRecursion, memory: jax.Array, now: jax.Array, middle: jax.Array) -> jax.Array:
    """State after a step with the input `now` at its start and `middle` half way; inputs (R, channels, S)."""
    decay, start, mid = (c[:, None, None, None] for c in (recursion.decay, recursion.start, recursion.middle))
    real, imaginary = memory
    return jnp.stack(
        [
            decay.real * real - decay.imag * imaginary + start.real * now + mid.real * middle,
            decay.imag * real + decay.real * imaginary + start.imag * now + mid.imag * middle,
        ]
    )
