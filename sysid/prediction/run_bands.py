"""Posterior bands of the driven runs: what every sensor should have shown, had the truck been that of a draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.arrays import DrawsByParameters
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.histories import shown_signals
from sysid.estimation.residuals.run_history import HistoryBand, RunHistory
from sysid.progress import Progress, unwatched

#: Number of posterior draws behind the bands.
DRAWS = 64


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
    shown: list[list[np.ndarray]] = [[] for _ in state.model.groups]
    for i, draw in enumerate(draws):
        progress("posterior bands of the driven runs", i / len(draws))
        model = state.model
        if amounts is not None:
            model = state.allowances.moved(model, amounts[i])
        simulated = shown_signals(model, state.point.weights, state.point.motion, draw)
        for of_group, one in zip(shown, simulated, strict=True):
            of_group.append(one.signals)
    bands: dict[int, HistoryBand] = {}
    for group, signals in zip(state.model.groups, shown, strict=True):
        for r, run in enumerate(group.runs):
            low, high = np.quantile(np.array([of_draw[:, r] for of_draw in signals]), [0.05, 0.95], axis=0)
            bands[run] = HistoryBand(low.T, high.T)
    return tuple(bands[run] for run in sorted(bands))


def with_bands(histories: Sequence[RunHistory], bands: Sequence[HistoryBand]) -> tuple[RunHistory, ...]:
    """Histories with their bands, which may go on where a shorter run of a group has ended."""
    return tuple(
        replace(h, band=HistoryBand(b.low[:, : len(h.time_s)], b.high[:, : len(h.time_s)]))
        for h, b in zip(histories, bands, strict=True)
    )
