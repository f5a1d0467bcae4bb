"""Stages on wheel loads: what the driven runs reached, passes nobody drove, and what to measure next for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.display import TextTable
from sysid.workflow.requested_passes import BUMP_SHAPES, requested_passes
from sysid.workflow.stage import Aside, Blocks, Command, Context, Option, Whole
from sysid.workflow.stages.cells import finite_cell
from sysid.workflow.stages.data import SCAN
from sysid.workflow.stages.fit import FIT, fit_state, shown_determined
from sysid.workflow.stages.posterior import SAMPLE, log_draws

if TYPE_CHECKING:
    from sysid.campaign.records import PredictionRequest
    from sysid.planning.advice_records import Advice
    from sysid.prediction.predicted_passes import Predictions
    from sysid.prediction.trust import DrivenRange
    from sysid.results.contents import Results


# ---------------------------------------------------------------------- driven


def _driven(context: Context) -> DrivenRange:
    from sysid.prediction.driven_range import driven_range

    context.progress("the driven runs at the optimum", 0.0)
    return driven_range(fit_state(context))


DRIVEN = Whole(
    name="driven",
    compute=_driven,
    needs=(SCAN, FIT),
    code=("prediction",),
    put=lambda results, driven: replace(results, driven=driven),
    in_run="always",
    effort=1.0,
)


# ---------------------------------------------------------------------- predict


def _predict(context: Context) -> Predictions:
    from sysid.prediction.predict_passes import SWEEP_KM_H

    return _predicted(context, context.campaign.predictions, () if context.settings.quick else SWEEP_KM_H)


def _requested(context: Context) -> Predictions:
    """Passes of the options (or requests of a caller) instead of those of the campaign, and no ratio against speed."""
    requests = context.options.get("requests") or requested_passes(context.campaign, context.options)
    return _predicted(context, requests, ())


def _predicted(context: Context, requests: Sequence[PredictionRequest], sweep_km_h: Sequence[float]) -> Predictions:
    from sysid.prediction.predict_passes import predict

    context.progress("passes", 0.0)
    posterior = context.known(SAMPLE)
    return predict(
        fit_state(context),
        None if posterior is None else log_draws(posterior),
        requests,
        seed=context.settings.seed,
        sweep_km_h=sweep_km_h,
        progress=context.progress,
        driven=context[DRIVEN],
    )


def _write_passes(predictions: Predictions, results: Results, folder: Path) -> Sequence[Path]:
    from sysid.export.tables import write_passes

    return write_passes(predictions, folder, results.judgement)


def show_predict(predictions: Predictions, results: Results) -> Blocks:
    """Peak dynamic load ratio per axle of every predicted pass."""
    axles = results.campaign.vehicle.axles
    for p in predictions.passes:
        table = TextTable(
            f"{p.load_case}, {3.6 * p.speed_m_s:.4g} km/h"
            + (f", {p.shape}" if p.shape else "")
            + ": peak dynamic load ratio",
            ("axle", "median", "90 % interval", "load coefficient", "off the road ms"),
        )
        for i, axle in enumerate(axles):
            low, high = p.peak_ratio_q05, p.peak_ratio_q95
            table.add_row(
                f"{i + 1} {axle.name}",
                f"{p.peak_ratio_q50[i]:.3f}",
                "-" if low is None or high is None else f"{low[i]:.3f} to {high[i]:.3f}",
                "-" if p.load_coefficient is None else f"{p.load_coefficient.q50[i]:.3f}",
                "-" if p.lift_off_s is None else f"{1e3 * p.lift_off_s.q50[i]:.0f}",
            )
        yield table
        yield from p.warnings


_PASS_OPTIONS = (
    Option("--speed", "Predict this speed [km/h] instead of the passes of the campaign; may be repeated.", "speeds",
           kind=float, limits=(0.0, 300.0), above=True, multiple=True),
    Option("--load-case", "Load case of --speed (default: the first).", "load_case"),
    Option("--bump", "Bump of --speed: a scan of the campaign (default: the first), or a file with a profile "
           "(CSV with station_m and height_m, or OpenCRG).", "bump", metavar="NAME|FILE"),
    Option("--lateral", "Long section of an OpenCRG file, metres to the left of its reference line (default: 0).",
           "lateral", kind=float, limits=(-1000.0, 1000.0)),
    Option("--shape", "Another bump by its shape, with --height and --length.", "shape", choices=BUMP_SHAPES),
    Option("--height", "Height of the shape [m].", "height", kind=float, limits=(0.001, 1.0)),
    Option("--length", "Length of the shape [m].", "length", kind=float, limits=(0.01, 100.0)),
    Option("--top", "Flat top of a trapezoid [m] (default: a third of its length).", "top", kind=float,
           limits=(0.0, 100.0)),
)  # fmt: skip

PREDICT = Whole(
    name="predict",
    compute=_predict,
    needs=(SCAN, FIT, DRIVEN),
    uses=(SAMPLE,),
    settings=("sampling.seed", "quick"),
    code=("prediction",),
    put=lambda results, predictions: replace(results, predictions=predictions),
    in_run="always",
    effort=15.0,
    command=Command(
        help="Dynamic wheel loads of the passes in the campaign file, or of others.",
        show=show_predict,
        next=("report", "--open"),
        options=_PASS_OPTIONS,
        aside=Aside(_requested, _write_passes),
    ),
)


# ---------------------------------------------------------------------- advise


def _advise(context: Context) -> Advice:
    from sysid.planning.ranking import advise

    determined = context[FIT].fit.identifiability
    assert determined is not None
    return advise(
        fit_state(context),
        determined,
        speeds_km_h=_speeds_km_h(context.options),
        progress=context.progress,
        driven=context[DRIVEN],
        predictions=context.known(PREDICT),
    )


def _speeds_km_h(options: Mapping[str, Any]) -> tuple[float, ...]:
    from sysid.planning.ranking import CANDIDATE_KM_H

    return tuple(options.get("candidate_speeds") or CANDIDATE_KM_H)


def _of_these_speeds(advice: Advice, options: Mapping[str, Any]) -> bool:
    """Whether stored advice is about the requested speeds."""
    return {f"{3.6 * p.speed_m_s:.6g}" for p in advice.runs} == {f"{v:.6g}" for v in _speeds_km_h(options)}


def show_advise(advice: Advice, results: Results) -> Blocks:
    """The benefit of every further run and sensor, then the best of them in words."""
    yield from shown_determined(None if results.fit is None else results.fit.identifiability)
    peak = "-" if advice.peak is None else f"peak ratio, {advice.peak.label}"
    columns = ("one further run", "worst of k and c", "median of k and c", peak)
    table = TextTable("Standard deviations after one further run", columns)
    for p in advice.rows:
        name, worst = advice.worst(p)
        table.add_row(
            p.label,
            f"{100.0 * worst:.2g} % ({name})",
            f"{100.0 * advice.median(p):.2g} %",
            finite_cell(p.peak_sd, ".2g"),
        )
    yield table
    yield from advice.statements


ADVISE = Whole(
    name="advise",
    compute=_advise,
    needs=(SCAN, FIT, DRIVEN),
    uses=(PREDICT,),
    code=("planning",),
    answers=_of_these_speeds,
    put=lambda results, advice: replace(results, advice=advice),
    in_run="full",
    effort=14.0,
    command=Command(
        help="What to measure next: further runs and sensors ranked by how much they would narrow the intervals.",
        show=show_advise,
        recalls=True,
        options=(
            Option(
                "--candidate-speed", "Speed [km/h] of further runs to judge; may be repeated (default: 8, 16, 24, 32).",
                "candidate_speeds", kind=float, limits=(0.0, 300.0), above=True, multiple=True,
            ),
        ),
    ),
)  # fmt: skip
