"""Stage of the results for the truck from drops, fit and posterior: values per axle, modes, curves, effective roads."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sysid.workflow.stage import Context, Whole
from sysid.workflow.stages.data import DROPS, SCAN
from sysid.workflow.stages.fit import FIT
from sysid.workflow.stages.posterior import SAMPLE

if TYPE_CHECKING:
    from sysid.estimates.records import Estimates


def _estimates(context: Context) -> Estimates:
    from sysid.estimates.derive import derive_estimates

    scans, kept = context.known(SCAN), context.known(FIT)
    return derive_estimates(
        context.campaign if kept is None else kept.point.in_campaign(context.campaign),
        context[DROPS],
        {} if scans is None else scans,
        None if kept is None else kept.fit,
        # A chain that is still written has no values to pass on yet.
        context.known(SAMPLE),
    )


ESTIMATES = Whole(
    name="estimates",
    compute=_estimates,
    needs=(DROPS,),
    # Whatever has run: the drops alone have something to show.
    uses=(SCAN, FIT, SAMPLE),
    code=("estimates",),
    # It takes seconds and stays in memory, so every report has it, whatever stages have run, also while a chain runs.
    in_file=False,
    put=lambda results, estimates: replace(results, estimates=estimates),
)
