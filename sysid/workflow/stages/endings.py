"""What is written from the results of all stages that have run: the report, and files for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.progress import Progress
from sysid.workflow.stage import Blocks, Command, Ending, Option

if TYPE_CHECKING:
    from sysid.results.contents import Results


# ---------------------------------------------------------------------- report


def _report(results: Results, folder: Path, progress: Progress) -> Sequence[Path]:
    from sysid.report import write_paper_figures, write_report
    from sysid.runtime import fewer_collections

    with fewer_collections():
        progress("report.html", 0.0)
        write_report(results, folder / "report.html", lambda share: progress("report.html", 0.8 * share))
        progress("figures", 0.8)
        drawn = write_paper_figures(results, folder / "figures", lambda share: progress("figures", 0.8 + 0.2 * share))
        return (folder / "report.html", *drawn)


def show_report(paths: Sequence[Path], results: Results) -> Blocks:
    """Where the report, or the page to sign, is."""
    yield f"{'Page to sign' if paths[0].suffix == '.pdf' else 'Report'}: {paths[0]}"


def _summary(results: Results, folder: Path, progress: Progress) -> Sequence[Path]:
    from sysid.report import write_summary

    progress("summary.pdf", 0.0)
    write_summary(results, folder / "summary.pdf")
    return (folder / "summary.pdf",)


REPORT = Ending(
    name="report",
    write=_report,
    effort=30.0,
    # Agreement is computed with the results that the report is made from.
    helper=("sysid.validation.agreement", "sysid.report.paper_figures"),
    command=Command(
        help="Write report.html from the stages that have run. With --summary one page to sign, summary.pdf.",
        show=show_report,
        recalls=True,
        options=(Option("--summary", "Write one page to print and sign, summary.pdf, instead.", "summary", kind=bool),),
    ),
)

#: What `report --summary` writes.
SUMMARY = Ending(name="summary", write=_summary, effort=3.0, command=REPORT.command)


# ---------------------------------------------------------------------- export


def _export(results: Results, folder: Path, progress: Progress) -> Sequence[Path]:
    from sysid.export.covariance_json import COVARIANCE_FILE, write_covariance
    from sysid.export.driven_loads import write_driven_loads
    from sysid.export.inference_data import write_posterior
    from sysid.export.models import write_models
    from sysid.export.result_json import result_identity, write_result
    from sysid.export.tables import write_parameters, write_predictions, write_profiles, write_validation

    written = [folder / "result.json", *write_driven_loads(results, folder)]
    if results.fit is not None:
        progress("tables", 0.0)
        write_parameters(results, folder / "parameters.csv")
        write_validation(results, folder / "validation.csv")
        written.append(folder / "parameters.csv")
        if results.validation is not None:
            written.append(folder / "validation.csv")
        if write_covariance(results, folder / COVARIANCE_FILE):
            written.append(folder / COVARIANCE_FILE)
        progress("files for other programs", 0.3)
        vehicles = () if results.estimates is None else results.estimates.vehicles
        written += write_models(
            results.campaign, vehicles, results.predictions, folder, results.judgement, result_identity(results)
        )
    written += write_profiles(results.profiles, folder)
    if results.predictions is not None:
        written += write_predictions(results, folder)
    if results.posterior is not None:
        progress("posterior.nc", 0.8)
        write_posterior(results, folder / "posterior.nc")
        written.append(folder / "posterior.nc")
    progress("result.json", 0.9)
    write_result(results, folder / "result.json")
    return written


def show_export(paths: Sequence[Path], results: Results) -> Blocks:
    """Which files were written."""
    return map(str, paths)


EXPORT = Ending(
    name="export",
    write=_export,
    effort=5.0,
    command=Command(
        help="Write result.json, tables and files for other programs. For LS-DYNA, Chrono and bridge codes; the "
        "draws as posterior.nc.",
        show=show_export,
        recalls=True,
    ),
)
