"""The runs of a fit with fewer samples: the same likelihood near one parameter set, for less work.

Sensors read faster than a truck moves.  With log parameters x near x_0 the signals y of a run change by slow motion d =
y(x) - y(x_0), and with the residuals e = y(x_0) - (measured) and weights w^2 of single readings the sum of squares is

    sum w^2 (e + d)^2 = const + 2 sum w^2 e d + sum w^2 d^2.

Of every m samples one is kept, with the weight W of those around it, and the residual E for which W E is m times the
low-passed w^2 e: both sums stay the same where d has no content above the band that the kept samples show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import firwin, oaconvolve

from sysid.arrays import Parameters, SamplesByRunsByChannels
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.larger_steps import MOST_CHANGE, STEPS_S, relative_change
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs

#: Length of the low-pass on each side, in kept samples, and shape of its Kaiser window: 80 dB beyond the transition.
_REACH, _SHAPE = 10, 8.0
#: Kept samples with less than this share of the full weight are left out: beside gaps the low-pass mixes too few.
_LEAST = 0.2


def with_fewer_samples(
    model: BumpModel,
    weights: Weights,
    log_parameters: Parameters,
    motion: RunMotion,
    steps_s: Sequence[float] = STEPS_S,
) -> tuple[BumpModel, Weights] | None:
    """The same runs at the longest sample interval that loses little, in one integration step each, with their weights.

    `groups` of the model keep all readings; its `arrays` have those to be used.

    Parameters
    ----------
    model, weights : of a fit.
    log_parameters, motion : x_0, (p,) and of every run.
    steps_s : sample intervals [s] to try, the longest first.

    Returns
    -------
    None if readings are no closer than half such an interval, if some are clipped (bounds have no linear residual), or
    if some channel has more than :data:`sysid.estimation.residuals.larger_steps.MOST_CHANGE` of its RMS above the band.
    """
    if any(np.any(arrays.censored) for arrays in model.arrays):
        return None
    exact: tuple[np.ndarray, ...] | None = None
    for step in steps_s:
        every = [max(1, int(step / s.interval_s + 1e-9)) for s in model.shapes]
        if max(every) < 2:
            return None
        shapes = tuple(_thinned(s, m, step) for s, m in zip(model.shapes, every, strict=True))
        exact = exact or simulate_runs(model, log_parameters, motion)
        kept = simulate_runs(replace(model, shapes=shapes), log_parameters, motion)
        if all(_alike(*pair) for pair in zip(exact, kept, every, strict=True)):
            arrays = [_with_residuals(weights.on(model.arrays, k), exact[k], kept[k], m) for k, m in enumerate(every)]
            plain = Weights(weights.noise_sd, weights.tempering)
            return replace(model, shapes=shapes, arrays=tuple(arrays)), plain
    return None


def _thinned(shape: GroupShape, every: int, step_s: float) -> GroupShape:
    interval = every * shape.interval_s
    substeps = max(1, int(np.ceil(interval / step_s - 1e-9)))
    return shape._replace(interval_s=interval, samples=-(-shape.samples // every), substeps=substeps)


def _alike(exact: SamplesByRunsByChannels, kept: SamplesByRunsByChannels, every: int) -> bool:
    """Whether kept samples are those of the exact signals, and show all that these do."""
    fast = exact - _low_passed(exact, every)
    return max(relative_change(kept - exact[::every], exact[::every]), relative_change(fast, exact)) <= MOST_CHANGE


def _with_residuals(
    arrays: GroupArrays, exact: SamplesByRunsByChannels, kept: SamplesByRunsByChannels, every: int
) -> GroupArrays:
    """Kept samples with the weights and residuals of all, at the signals of x_0."""
    share = np.asarray(arrays.measured) ** 2
    hat = 1.0 - np.abs(np.arange(1 - every, every)) / every
    weight = _convolved(share, hat)[::every]
    pull = every * _low_passed(share * (exact - arrays.value), every)[::every]
    full = every * share.max(axis=0)
    used = weight > _LEAST * np.where(full > 0.0, full, 1.0)
    residual = np.where(used, pull / np.where(used, weight, 1.0), 0.0)
    return arrays._replace(
        value=np.where(used, kept - residual, 0.0),
        measured=np.where(used, np.sqrt(np.where(used, weight, 0.0)), 0.0),
        censored=np.zeros(kept.shape),
    )


def _low_passed(signals: SamplesByRunsByChannels, every: int) -> SamplesByRunsByChannels:
    """Signals without what is faster than half the rate of the kept samples, not delayed."""
    if every == 1:
        return signals
    return _convolved(signals, firwin(2 * _REACH * every + 1, 1.0 / every, window=("kaiser", _SHAPE)))


def _convolved(signals: SamplesByRunsByChannels, kernel: np.ndarray) -> SamplesByRunsByChannels:
    return np.asarray(oaconvolve(signals, kernel[:, None, None], mode="same", axes=0))
