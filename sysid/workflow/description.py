"""A calibration in a screen of text: what has run, and k and c of every axle in the units of the trade."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.estimates.suspension_values import suspension_estimates
from sysid.numbers import count, listing
from sysid.results.headline import estimate_words, paired_rows

if TYPE_CHECKING:
    from sysid.campaign.records import Campaign
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.sdof.drop_results import DropSummary


def described(
    campaign: Campaign,
    output: str,
    finished: Sequence[str],
    drops: DropSummary | None,
    fit: FitResult | None,
    posterior: Posterior | None,
) -> str:
    """Title, size and folder of a campaign, the stages that have run, and a table of k and c.

    Parameters
    ----------
    output : name of the output folder.
    finished : names of the stages with results.
    drops, fit, posterior : their results, None for what has not run.
    """
    axles = campaign.vehicle.axles
    size = f"{count(len(axles), 'axle')}, {count(len(campaign.plank_drops), 'plank drop')}, "
    lines = [f"Calibration of '{campaign.title}' in {output}", f"{size}{count(len(campaign.bump_runs), 'bump run')}"]
    if not finished:
        return "\n".join(
            [*lines, "Nothing has run yet: check(), drops(), fit(), sample(), predict(), or run() for all."]
        )
    lines.append(f"Finished: {listing(list(finished), len(finished))}")
    rows = paired_rows(*(suspension_estimates(q, drops, fit, posterior) for q in ("stiffness", "damping")))
    if not rows:
        return "\n".join(lines)
    of = {"posterior": "posterior", "fitted": "least squares"}
    best = next(e for row in rows for e in (row.stiffness, row.damping) if e)
    table = [("axle", "k [kN/m]", "c [kN s/m]")]
    for row in rows:
        name = f"{row.axle + 1} {axles[row.axle].name}" + (f", {row.load_case}" if row.load_case else "")
        table.append((name, estimate_words(row.stiffness), estimate_words(row.damping)))
    widths = [max(len(cells[i]) for cells in table) for i in range(3)]
    lines += [f"{a:<{widths[0]}}  {k:>{widths[1]}}  {c:>{widths[2]}}" for a, k, c in table]
    return "\n".join(
        [*lines, f"{of.get(best.source, 'plank drops')}, ± half of the 90 % interval; values are in SI units"]
    )
