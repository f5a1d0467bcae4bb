"""How well the truck of one campaign explains the runs of another, which it has not seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sysid.comparison.records import Agreement
from sysid.numbers import listing
from sysid.validation.agreement import validate
from sysid.validation.channel_agreement import ChannelAgreement, channel_median
from sysid.validation.leave_out import by_another_truck
from sysid.workflow.calibration import Calibration
from sysid.workflow.settings import make_settings, recall

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.fit.state import FitState


class Driven(NamedTuple):
    """A finished campaign that can be driven again: its `label` in tables, results and state of its fit."""

    label: str
    fit: FitResult
    state: FitState


def finished(campaign: str | Path, folder: Path, label: str) -> Driven:
    """The fit in an output folder, with the options with which it was made.

    Raises
    ------
    CampaignError
        If the folder holds no fit of this campaign file.
    """
    return Driven(label, *Calibration(campaign, folder, make_settings(**recall(folder))).finished_fit())


def on_each_other(first: Driven, second: Driven) -> tuple[tuple[Agreement, ...], tuple[str, ...]]:
    """Agreement of the runs of both with the truck of the other, and sentences about runs that it cannot drive."""
    found, said = [], []
    for recorded, truck in ((first, second), (second, first)):
        own = validate(recorded.fit).channels
        other = by_another_truck(truck.state, recorded.fit, recorded.state)
        files = [run.log.file for run in recorded.state.campaign.bump_runs]
        driven = {row.run for row in other}
        found += [
            Agreement(file, recorded.label, _of_run(own, file), _of_run(other, file))
            for file in files
            if file in driven
        ]
        left = [file for file in files if file not in driven]
        if left:
            said.append(
                f"Not driven by the truck of {truck.label}, which was weighed in other load cases: {listing(left)}."
            )
    return tuple(found), tuple(said)


def _of_run(rows: Sequence[ChannelAgreement], file: str) -> float | None:
    median = channel_median([row for row in rows if row.run == file], "residual_over_noise")
    return median if math.isfinite(median) else None
