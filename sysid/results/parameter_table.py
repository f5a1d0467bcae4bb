"""The table of all parameters, least squares beside posterior: `parameters.csv` and the summary of all results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.campaign.vehicle_records import Axle
from sysid.csv_cells import csv_text, escape_cell, number_cell

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.posterior.sampled_posterior import Posterior

PARAMETER_COLUMNS = (
    "name",
    "quantity",
    "axle",
    "axle_name",
    "load_case",
    "run",
    "law",
    "unit",
    "identified",
    "least_squares_value",
    "least_squares_sd",
    "posterior_mean",
    "posterior_sd",
    "posterior_q05",
    "posterior_q50",
    "posterior_q95",
    "posterior_ess",
    "posterior_rhat",
    "verdict",
)

_SUMMARY_KEYS = ("mean", "sd", "q05", "q50", "q95", "ess", "rhat")


def parameter_table(
    axles: Sequence[Axle], fit: FitResult | None, posterior: Posterior | None, trust: str | None = None
) -> str:
    """The text of `parameters.csv`: one row per parameter in SI units, empty cells for what is not known.

    The last column says in every row whether the numbers may be used (`trust`), as `result.json` does.
    """
    summaries = {} if posterior is None else {s.name: s for s in posterior.summaries}
    rows = []
    for p in () if fit is None else (*fit.parameters, *fit.run_parameters):
        summary = summaries.get(p.name)
        sampled = [None] * 7 if summary is None else [getattr(summary, key) for key in _SUMMARY_KEYS]
        rows.append(
            [
                escape_cell(p.name),
                escape_cell(p.quantity),
                "" if p.axle is None else p.axle + 1,
                "" if p.axle is None else escape_cell(axles[p.axle].name),
                escape_cell(p.load_case or ""),
                escape_cell(p.run or ""),
                escape_cell(p.law),
                p.unit,
                "true" if p.identified else "false",
                *(number_cell(value) for value in (p.value, p.sd, *sampled)),
                trust or "",
            ]
        )
    return csv_text(PARAMETER_COLUMNS, rows)
