"""Stages on axle loads: what the driven runs reached, passes nobody drove, and what to measure next for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.display import TextTable
from sysid.limits import BRIDGE_VEHICLES, ROAD_LENGTH_M, ROAD_REALISATIONS
from sysid.workflow.requested_passes import BUMP_SHAPES, refuse_passes, requested_passes
from sysid.workflow.stage import Aside, Blocks, Command, Context, Option, Whole
from sysid.workflow.stages.bridges import shown_bridges
from sysid.workflow.stages.cells import finite_cell
from sysid.workflow.stages.data import SCAN
from sysid.workflow.stages.fit import FIT, fit_state, shown_determined
from sysid.workflow.stages.posterior import SAMPLE, log_draws

if TYPE_CHECKING:
    from sysid.campaign.records import PredictionRequest
    from sysid.planning.advice_records import Advice
    from sysid.prediction.predicted_passes import PassPrediction, Predictions, RoadLoads, WheelLoads
    from sysid.prediction.quantiles import Quantiles
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
    from sysid.export.load_effects import write_load_effects
    from sysid.export.models import write_moving_forces
    from sysid.export.tables import write_passes

    written = write_passes(predictions, folder, results.judgement, results.trust)
    written += write_load_effects(predictions.passes, folder, "load_effects_asked", results.trust)
    if any(p.bridge is not None for p in predictions.passes):
        from sysid.report.bridge_figures import write_bridge_figures

        x = [axle.x_m for axle in results.campaign.vehicle.axles]
        written += write_bridge_figures(predictions.passes, x, folder, "load_effects_asked")
    if any(p.road is not None for p in predictions.passes):
        from sysid.campaign.requests import driven_speeds
        from sysid.report.road_figures import write_road_figures

        x = [axle.x_m for axle in results.campaign.vehicle.axles]
        speeds = {p.load_case: driven_speeds(results.campaign, p.load_case) for p in predictions.passes}
        written += write_road_figures(predictions.passes, x, speeds, folder, "road_asked")
    return (*written, *write_moving_forces(results.campaign, predictions, folder, results.judgement))


def show_predict(predictions: Predictions, results: Results) -> Blocks:
    """Axle loads and peak dynamic load ratio of every predicted pass; over a rough road its measures too."""
    axles = results.campaign.vehicle.axles
    for p in predictions.passes:
        if p.bridge is not None:
            continue
        columns = ("axle", "static kN", "peak kN", "90 % interval", "median", "90 % interval", "load coefficient")
        table = TextTable(
            f"{p.load_case}, {3.6 * p.speed_m_s:.4g} km/h"
            + (f", {p.shape}" if p.shape else "")
            + ": axle load (both sides together) and peak dynamic load ratio",
            (*columns, "off the road ms") if p.road is None else (*columns, "95 % kN", "road stress"),
        )
        load = p.axle_load_kN
        for i, axle in enumerate(axles):
            last = (
                ("-" if p.lift_off_s is None else f"{1e3 * p.lift_off_s.q50[i]:.0f}",)
                if p.road is None
                else (f"{1e-3 * p.road.load_95_N.q50[i]:.1f}", f"{p.road.road_stress.q50[i]:.3f}")
            )
            table.add_row(
                f"{i + 1} {axle.name}",
                f"{1e-3 * p.static_load_N[i]:.1f}",
                f"{load.q50[i]:.1f}",
                _interval(load, i, 1),
                f"{p.peak_ratio_q50[i]:.3f}",
                _interval(p.peak_ratio, i, 3),
                "-" if p.load_coefficient is None else f"{p.load_coefficient.q50[i]:.3f}",
                *last,
            )
        yield table
        if p.road is not None:
            yield _road_words(p.road)
        if p.wheels is not None:
            yield _heaviest_wheel(p, p.wheels)
        yield from p.warnings
    yield from shown_bridges(predictions.passes)
    yield from _repeated(predictions)
    if predictions.source != "posterior":
        yield "There are no intervals: no posterior has been sampled yet (run, or sample)."


def _repeated(predictions: Predictions) -> Blocks:
    """How much of the load along a road repeats from pass to pass, where there are several over one road."""
    from sysid.prediction.road_measures import passes_of_one_road, repeatability

    pairs = [(a, b) for a, b in passes_of_one_road(predictions.passes) if a is not b]
    if not pairs:
        return
    table = TextTable(
        "Spatial repeatability: correlation of the load of all axles along the road (1: the same places bear most)",
        ("road", "pass", "and pass", "correlation", "90 % interval"),
    )
    for a, b in pairs:
        assert a.road is not None
        assert b.road is not None
        found = repeatability(a.road.aggregate_N, b.road.aggregate_N)
        names = (f"{p.load_case}, {3.6 * p.speed_m_s:.4g} km/h" for p in (a, b))
        table.add_row(a.shape, *names, f"{found.q50[0]:.2f}", _interval(found, 0, 2))
    yield table


def _interval(values: Quantiles, axle: int, places: int) -> str:
    low, high = values.q05, values.q95
    return "-" if low is None or high is None else f"{low[axle]:.{places}f} to {high[axle]:.{places}f}"


def _heaviest_wheel(p: PassPrediction, wheels: WheelLoads) -> str:
    """The wheel with the largest load over half the static load of its axle."""
    from sysid.prediction.predicted_passes import SIDES

    side, axle = wheels.heaviest(p.static_load_N)
    load = wheels.peak_N.at(side).times(1e-3)
    share = 2e3 * load.q50[axle] / p.static_load_N[axle]
    return (
        f"Heaviest wheel: axle {axle + 1} {SIDES[side]}, {load.q50[axle]:.1f} kN ({_interval(load, axle, 1)}), "
        f"{share:.2f} times half the static load of its axle."
    )


def _road_words(road: RoadLoads) -> str:
    density = "" if road.density_m3 is None else f"{1e6 * road.density_m3:.3g}e-6 m3"
    known = f", class {road.road_class} (G_d(n_0) = {density})" if density else ""
    stress, together = (_with_interval(q) for q in (road.vehicle_stress, road.aggregate_95))
    return (
        f"Road: {road.length_m:g} m, IRI {road.roughness_index_mm_m:.2f} mm/m{known}. Stress of the whole vehicle, "
        f"power {road.exponent:g}: {stress} times that of its loads at rest; 5 % of the road bears more than "
        f"{together} times."
    )


def _with_interval(values: Quantiles) -> str:
    text = f"{values.q50[0]:.3f}"
    return text if values.q05 is None else f"{text} ({_interval(values, 0, 3)})"


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
    Option("--length", "Length of the shape [m], or of a road (default: 500 of a class, all of a file).", "length",
           kind=float, limits=(0.01, ROAD_LENGTH_M)),
    Option("--top", "Flat top of a trapezoid [m] (default: a third of its length).", "top", kind=float,
           limits=(0.0, 100.0)),
    Option("--road", "Rough road of --speed in place of a bump: a class of ISO 8608 (A to H), with --length and "
           "--seed, or a file with a measured profile (CSV with station_m and height_m, ERD, or OpenCRG); several one "
           "behind the other as C:200+deck.csv+C:100.", "road", metavar="CLASS|FILE"),
    Option("--at", "Station [m] on the --road at which the bump of --bump FILE or --shape begins.", "at", kind=float,
           limits=(0.0, ROAD_LENGTH_M)),
    Option("--hole", "The shape of --at is a hole in the road, not a bump on it.", "hole", kind=bool),
    Option("--stress-exponent", "Exponent of the damage that axle loads do to the --road (default: 4).",
           "stress_exponent", kind=float, limits=(1.0, 12.0)),
    Option("--realisations", "Roads of the class that are driven, with seeds from --seed on (default: 1).",
           "realisations", kind=int, limits=(1, ROAD_REALISATIONS)),
    Option("--bridge", "Bridge of --speed in place of a bump: [bridge.NAME] of the campaign or a TOML file with its "
           "keys; --road CLASS is then its surface.", "bridge", metavar="NAME|FILE"),
    Option("--vehicles", "Equal vehicles one behind the other on the bridge (default: 1), with --gap.", "vehicles",
           kind=int, limits=(1, BRIDGE_VEHICLES)),
    Option("--gap", "Last axle of a vehicle to the first of the next [m] (default: 10).", "gap", kind=float,
           limits=(0.0, 1000.0), above=True),
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
    effort=13.0,
    command=Command(
        help="Axle loads of the passes in the campaign file, or of others.",
        show=show_predict,
        next=("report", "--open"),
        options=_PASS_OPTIONS,
        aside=Aside(_requested, _write_passes, seeded="road"),
        refuse=refuse_passes,
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
        help="Which further run or sensor would tell most. Ranked by how much they would narrow the intervals.",
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
