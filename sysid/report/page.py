"""The report: one HTML page without any reference outside itself, made from results alone."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sysid.estimates.suspension_values import Quantity
from sysid.estimation.fit.thresholds import MISFIT
from sysid.export.identity import stamped
from sysid.export.result_json import result_identity
from sysid.files import write_text
from sysid.numbers import number
from sysid.report import (
    agreement,
    answer,
    cells,
    drop_tables,
    explorer,
    figures,
    first_screen,
    knowledge,
    load_tables,
    tables,
)
from sysid.report.bridge_figures import effect_pictures
from sysid.report.skeleton import render_page
from sysid.report.verdict import verdict
from sysid.results import Results
from sysid.results.pass_limits import half_declared_travel, undeclared_travel

_QUANTITIES: tuple[Quantity, ...] = ("stiffness", "damping")


def render_report(results: Results, done: Callable[[float], None] = lambda share: None) -> str:
    """The whole report as the text of one HTML page.

    Stages that have not run are named as such.  Everything that comes from the user (titles, names, files, columns,
    notes, messages) is escaped; the page loads nothing, and its content security policy forbids it to.  `done` is told
    the share of the figures that are drawn.
    """
    return stamped("report.html", render_page("report.html", _content(results, done)), result_identity(results))


def write_report(results: Results, path: Path, done: Callable[[float], None] = lambda share: None) -> None:
    """Write the report to `path`, complete or not at all; `done` as for :func:`render_report`."""
    write_text(path, render_report(results, done))


def _content(results: Results, done: Callable[[float], None]) -> dict[str, Any]:
    gallery = figures.Gallery()
    drop_shown, drop_all = figures.drop_pictures(results, gallery)
    history_shown, history_all = figures.history_pictures(results, gallery)
    # The gallery numbers its pictures as they come: the parts stay in this order.
    content = {
        **_answer(results, gallery),
        **_loads(results, gallery),
        "comparison": figures.comparison_pictures(results, gallery),
        **_measurements(results, gallery),
        "drop_shown": drop_shown,
        "drop_all": drop_all,
        "history_shown": history_shown,
        "history_all": history_all,
        **_calibration(results, gallery),
        **_provenance(results),
        "misfit": MISFIT,
    }
    gallery.draw(done)
    return content


def _answer(results: Results, gallery: figures.Gallery) -> dict[str, Any]:
    """What the page says first."""
    return {
        "r": results,
        "verdict": verdict(results),
        "preview": results.status == "preview",
        "estimates": [t for q in _QUANTITIES if (t := tables.estimates_table(results, q)) is not None],
        "answer_table": answer.answer_table(results),
        "axle_loads": answer.axle_load_table(results),
        "runs_data": explorer.runs_data(results),
        "passes_data": explorer.passes_data(results),
        # Drawn from in the order of the page: figures that are seen and printed, and those that are folded.
        "figure_numbers": map(str, itertools.count(1)),
        "folded_numbers": (f"A{i}" for i in itertools.count(1)),
        "subject": _subject(results),
        "truck": first_screen.truck_picture(results, gallery),
        "first_pictures": [
            *first_screen.speed_picture(results, gallery),
            *first_screen.worst_picture(results, gallery),
        ],
        "fit_words": "" if results.fit is None else figures.fit_words(results.fit),
    }


def _subject(results: Results) -> list[str]:
    """Vehicle, date, place and operator of the test, day of the calibration, inputs, program: what to file it under."""
    details = results.campaign.details
    said = [results.campaign.vehicle.name, details.vehicle_id, details.date, details.place, details.operator]
    files = "".join(f"{name} {digest}\n" for name, digest in sorted(results.input_sha256.items()))
    mark = hashlib.sha256(files.encode("utf-8")).hexdigest()[:12]
    program, day = results.provenance.get("versions", {}).get("sysid"), str(results.provenance.get("date") or "")[:10]
    marks = [f"calibrated {day}"] * bool(day) + [f"inputs {mark}"] * bool(files) + [f"sysid {program}"] * bool(program)
    return [*(text for text in said if text), *marks]


def _measurements(results: Results, gallery: figures.Gallery) -> dict[str, Any]:
    """The vehicle, what was measured on it, and the drops by themselves."""
    channels = () if results.quality is None else results.quality.channels
    return {
        "vehicle": tables.vehicle_table(results),
        "channels": channels,
        "verdicts": {v: sum(c.verdict == v for c in channels) for v in ("good", "usable", "rejected")},
        "remarkable": tables.quality_table([c for c in channels if c.verdict != "good"], "Channels with findings"),
        "all_channels": tables.quality_table(channels, "All channels"),
        "pooled": None if results.drops is None else drop_tables.pooled_drops_table(results, results.drops),
        "drop_notes": [] if results.drops is None else drop_tables.pooled_notes(results.drops),
        "drop_files": None if results.drops is None else drop_tables.files_table(results.drops),
        "indicator": None if results.drops is None else drop_tables.indicator_table(results, results.drops),
        "scan_pictures": figures.scan_pictures(results, gallery),
        "residuals": figures.residual_picture(results, gallery),
    }


def _calibration(results: Results, gallery: figures.Gallery) -> dict[str, Any]:
    """The fit, what it determines, and the posterior."""
    modes = () if results.estimates is None else results.estimates.modes
    return {
        "fit_table": None if results.fit is None else tables.fit_table(results.fit),
        "global_parameters": None
        if results.fit is None
        else tables.parameters_table(results, results.fit.parameters, "Parameters of vehicle and tires"),
        "masses": None if results.fit is None else tables.masses_table(results.fit),
        "run_parameters": None
        if results.fit is None
        else tables.parameters_table(results, results.fit.run_parameters, "Parameters of single runs"),
        "shrinkage": knowledge.shrinkage_table(results),
        "shares": knowledge.shares_table(results),
        "share_words": knowledge.share_words(results),
        "shrinkage_pictures": figures.shrinkage_pictures(results, gallery),
        "profile_pictures": figures.profile_pictures(results, gallery),
        "advice": knowledge.advice_table(results),
        "advice_pictures": figures.advice_pictures(results, gallery),
        "laws": tables.law_table(results),
        "parts_table": tables.parts_table(results),
        "contacts": tables.contact_table(results),
        "balance": tables.balance_table(results),
        "driven_loads": tables.driven_loads_table(results),
        "driven_tires": tables.driven_tires_table(results),
        "driven_roads": tables.driven_roads_table(results),
        "loop_pictures": figures.loop_pictures(results, gallery),
        "modes": tables.modes_table(modes),
        "mode_pictures": figures.mode_pictures(modes, gallery),
        "posterior_table": None if results.posterior is None else tables.posterior_table(results.posterior),
        "posterior_pictures": figures.posterior_pictures(results, gallery),
    }


def _loads(results: Results, gallery: figures.Gallery) -> dict[str, Any]:
    """Agreement with the runs and predicted axle loads."""
    run_names = _run_names(results)
    return {
        "agreement": _agreement(results, run_names),
        "left_out": _left_out(results, run_names),
        "prediction_tables": load_tables.prediction_tables(results),
        "effect_tables": load_tables.effect_tables(results),
        "effect_pictures": effect_pictures(results, gallery),
        "trust_tables": load_tables.trust_tables(results),
        "prediction_pictures": figures.prediction_pictures(results, gallery),
        "prediction_shown": figures.paper_pass_pictures(results, gallery),
        "sweep_pictures": figures.sweep_pictures(results, gallery),
        "sweep_tables": load_tables.sweep_tables(results),
        "undeclared": [f"axle {i + 1}" for i in undeclared_travel(results)],
        "half_declared": [f"axle {i + 1}" for i in half_declared_travel(results)],
    }


def _provenance(results: Results) -> dict[str, Any]:
    """Settings, versions, timings and seed."""
    return {
        "settings": tables.flat_settings(results.provenance.get("settings", {})),
        "versions": dict(results.provenance.get("versions", {})),
        "timing_rows": [(k, number(v)) for k, v in results.provenance.get("timings", {}).items()],
        "seed": results.provenance.get("seed", results.posterior.seed if results.posterior else None),
    }


def _agreement(results: Results, run_names: dict[str, str]) -> list[cells.Table]:
    validation = results.validation
    if validation is None:
        return []
    return [
        agreement.summary_table(validation, run_names),
        agreement.ratings_table(validation),
        agreement.matrix_table(validation, run_names, "NRMSE per channel and run", agreement.nrmse_cell),
        agreement.matrix_table(
            validation, run_names, "Residual over noise before the bump per channel and run [-]", agreement.noise_cell
        ),
        agreement.matrix_table(
            validation, run_names, "ISO/TS 18571 rating per channel and run [-]", agreement.rating_cell
        ),
    ]


def _left_out(results: Results, run_names: dict[str, str]) -> cells.Table | None:
    left_out = None if results.validation is None else results.validation.left_out
    return None if left_out is None else agreement.left_out_table(left_out, run_names)


def _run_names(results: Results) -> dict[str, str]:
    return {r.log.file: f"{r.case}, run\u00a0{r.repeat}" for r in results.campaign.bump_runs}
