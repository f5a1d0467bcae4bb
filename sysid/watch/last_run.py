"""The run that landed last, measured over simulated, from the fit of a preview."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.estimation.residuals.run_history import RunHistory
from sysid.workflow.store import load_part


@dataclass(frozen=True)
class LastRun:
    """A run and its channel `column` in which the model misses most; `misfit` is residual over noise there."""

    history: RunHistory
    column: str
    misfit: float


def last_run(preview: Path, landed: Sequence[str]) -> LastRun | None:
    """What the fit in a folder of results says of the last run; None where there is no fit.

    Parameters
    ----------
    landed : names of logs in the order in which they landed.
    """
    histories = load_part(preview / "stages" / "fit.npz", ("fit", "histories"), tuple[RunHistory, ...])
    if not histories:
        return None
    place = {name: number for number, name in enumerate(landed)}
    history: RunHistory = max(histories, key=lambda h: place.get(h.file, -1))
    noise = history.noise_before_sd
    known = np.isfinite(history.noise_sd) & (noise > 0.0)
    misfit = np.where(known, history.noise_sd / np.where(known, noise, 1.0), -1.0)
    worst = int(np.argmax(misfit))
    return LastRun(history, history.columns[worst], float(misfit[worst])) if known.any() else None
