"""Posterior bands of the driven runs: what every sensor should have shown, had the truck been that of a draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.arrays import DrawsByParameters
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.by_group import each_group, too_many
from sysid.estimation.residuals.histories import shown_signals
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_history import HistoryBand, RunHistory
from sysid.progress import Progress, unwatched
from sysid.threads import side_by_side

#: Number of posterior draws behind the bands.
DRAWS = 64
_WORDS = "posterior bands of the driven runs"


def run_bands(
    state: FitState,
    draws: DrawsByParameters,
    *,
    seed: int = 0,
    progress: Progress = unwatched,
) -> tuple[HistoryBand, ...]:
    """Pointwise 90 % bands of all sensor signals of every run, in the order of the campaign.

    Every draw gets its own masses and departures from the model, as in predicted passes. It uses the speed and start of
    each run. Offset and gain of its sensors are eliminated against the record, as in the fit.

    Parameters
    ----------
    state : the fit.
    draws : (n, p) posterior draws of the log parameters, thinned at random to `DRAWS`.
    """
    random = np.random.default_rng(seed)
    if draws.shape[0] > DRAWS:
        draws = draws[random.choice(draws.shape[0], DRAWS, replace=False)]
    response = state.point.mass_response
    amounts = None if response is None else response.draws(draws, random)

    model, weights = state.model, state.point.weights
    if not too_many(model, len(draws)):
        bands = _bands(state, model, weights, draws, amounts, progress)
        return tuple(bands[run] for run in sorted(bands))

    def of_group(k: int) -> dict[int, HistoryBand]:
        progress(_WORDS, k / len(model.groups))
        return _bands(state, model.part(k), weights.part(k), draws, amounts, unwatched)

    bands = {run: band for part in each_group(of_group, len(model.groups)) for run, band in part.items()}
    return tuple(bands[run] for run in sorted(bands))


def _bands(
    state: FitState,
    model: BumpModel,
    weights: Weights,
    draws: DrawsByParameters,
    amounts: np.ndarray | None,
    progress: Progress,
) -> dict[int, HistoryBand]:
    """Bands by run of all runs of a model, or of a part of it, with the masses and departures of the draws (n, q)."""

    def shown(i: int) -> list[np.ndarray]:
        progress(_WORDS, i / len(draws))
        moved = model if amounts is None else state.allowances.moved(model, amounts[i])
        return [one.signals for one in shown_signals(moved, weights, state.point.motion, draws[i])]

    # While the engine computes for one thread, another one moves the model.
    of_draws = side_by_side(shown, range(len(draws)))
    bands: dict[int, HistoryBand] = {}
    for group, *signals in zip(model.groups, *of_draws, strict=True):
        bands |= zip(group.runs, side_by_side(partial(_band, signals), range(len(group.runs))), strict=True)
    return bands


def _band(signals: Sequence[np.ndarray], run: int) -> HistoryBand:
    """The band of one run of a group from the signals (T, R, C) of every draw."""
    low, high = np.quantile(np.array([of_draw[:, run] for of_draw in signals]), [0.05, 0.95], axis=0)
    return HistoryBand(low.T, high.T)


def with_bands(histories: Sequence[RunHistory], bands: Sequence[HistoryBand]) -> tuple[RunHistory, ...]:
    """Histories with their bands, which may go on where a shorter run of a group has ended."""
    return tuple(
        replace(h, band=HistoryBand(b.low[:, : len(h.time_s)], b.high[:, : len(h.time_s)]))
        for h, b in zip(histories, bands, strict=True)
    )
