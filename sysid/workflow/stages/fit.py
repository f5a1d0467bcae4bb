"""Stages of least squares: the fit, its agreement with the records, runs left out, and profiles of the deviance."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from sysid.display import NOT_DETERMINED, CommandHint, TextTable, shown_unit
from sysid.errors import CampaignError, DataRejectedError, NotConvergedError
from sysid.workflow.stage import Blocks, Command, Context, Itemwise, Option, Whole
from sysid.workflow.stages.cells import finite_cell, value_cell
from sysid.workflow.stages.data import CHECK, DROPS, SCAN

if TYPE_CHECKING:
    from sysid.campaign.declared import Declared
    from sysid.campaign.loggers import ClockFinding
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.fit.profiles import ProfileLikelihood
    from sysid.estimation.fit.state import FitPoint, FitState
    from sysid.estimation.uncertainty.identifiability import Identifiability
    from sysid.results.contents import Results
    from sysid.road.road_profile import RoadProfile
    from sysid.validation.channel_agreement import ChannelAgreement, LeftOutRun, Validation

#: Said of laws of a preview.
UNTRIED = (
    "Preview: elements were added and removed by their expected gain; no fit without each of them has proved that it "
    "is needed."
)


# ---------------------------------------------------------------------- fit


@dataclass(frozen=True)
class KeptFit:
    """The result of least squares, and the point from which the stages that follow start."""

    fit: FitResult
    point: FitPoint


def _fit(context: Context) -> KeptFit:
    from sysid.estimation.fit.law_choice import fit_with_laws
    from sysid.runtime import forget_compiled

    if not context.campaign.bump_runs:
        why = context[CHECK].left_out
        raise DataRejectedError(
            f"No bump run is left to fit. {why[0]}"
            if why
            else "No bump run is left to fit: every log was rejected or none is listed; see the stage 'check'."
        )
    options = context.settings.fit
    # The largest of all stages: it does not need what was compiled for the drops.
    forget_compiled(0.0)
    fit, state = fit_with_laws(context.campaign, context[DROPS], profiles(context), options, context.progress)
    return KeptFit(fit, state.point)


def profiles(context: Context) -> dict[str, RoadProfile]:
    """Road profile of every bump, for stages that need SCAN."""
    return {name: analysis.profile for name, analysis in context[SCAN].items()}


def fit_state(context: Context) -> FitState:
    """The finished fit, for stages that need SCAN and FIT."""
    from sysid.estimation.fit.state import restored

    return restored(context.campaign, profiles(context), context[FIT].point)


def show_fit(kept: KeptFit, results: Results) -> Blocks:
    """Least-squares values of all parameters beside their priors, and what the data determine."""
    yield from shown_fit(kept.fit)
    yield from _clocks(kept.point.clocks)


def shown_fit(fit: FitResult) -> Blocks:
    """Tables and sentences of a fit."""
    yield from _laws(fit)
    columns = ("parameter", "value", "unit", "prior", "sd / prior sd", "known from the data")
    table = TextTable("Least squares", columns)
    for p in fit.parameters:
        factor, unit = shown_unit(p.unit)
        table.add_row(
            p.name,
            value_cell(p.value, p.sd, factor) if p.identified else NOT_DETERMINED,
            unit,
            f"{p.prior_median * factor:.4g} ± {100.0 * p.prior_sd:.2g} %",
            f"{p.sd / p.value / p.prior_sd:.2f}",
            "yes" if p.identified else "no",
        )
    yield table
    for rocker in fit.load_shares:
        yield rocker.words
    yield f"{fit.iterations} iterations, {fit.residuals} residuals: {fit.message}."
    yield from shown_determined(fit.identifiability)
    for warning in fit.warnings:
        if fit.identifiability is None or warning not in fit.identifiability.statements:
            yield warning


def _clocks(clocks: Sequence[ClockFinding]) -> Blocks:
    if not clocks:
        return
    table = TextTable("Clocks as the fit has them", ("log", "logger", "offset s", "moved ms", "rate ppm"))
    for c in clocks:
        if c.is_unknown:
            offset, rate = c.offset_s + c.moved_s, c.rate + c.moved_rate
            table.add_row(c.other_file, c.logger, f"{offset:+.5f}", f"{1e3 * c.moved_s:+.2f}", f"{1e6 * rate:+.1f}")
    yield table


def _laws(fit: FitResult) -> Blocks:
    if fit.law_comparison is None:
        return
    table = TextTable("Suspension laws tried", ("laws", "parameters", "residual / noise", "gain", "chosen"))
    for t in fit.law_comparison.trials:
        laws = t.laws[0] if len(set(t.laws)) == 1 else "; ".join(f"{i + 1}: {law}" for i, law in enumerate(t.laws))
        chosen = "yes" if t.laws == fit.law_comparison.chosen else ""
        table.add_row(laws, str(t.parameters), f"{t.misfit:.2f}", finite_cell(t.gain, ".4g"), chosen)
    yield table
    if fit.law_comparison.untried:
        yield UNTRIED
    for undecided in fit.law_comparison.undecided:
        yield undecided.sentence


def shown_determined(identifiability: Identifiability | None) -> Blocks:
    """What the data determine, in words."""
    if identifiability is None:
        return
    some = f"{identifiability.determined} of {len(identifiability.names)}"
    yield f"The data determine {some} combinations of the parameters better than the priors do."
    yield from identifiability.statements
    yield from identifiability.share_sentences
    if identifiability.warnings:
        yield CommandHint("Which run or sensor would help", ("advise",))


FIT = Whole(
    name="fit",
    compute=_fit,
    needs=(CHECK, DROPS, SCAN),
    settings=("fit",),
    code=("estimation",),
    # What follows shows the vehicle with the parts that the fit added, and records on the clocks that it found.
    put=lambda results, kept: replace(results, fit=kept.fit, campaign=kept.point.in_campaign(results.campaign)),
    in_run="always",
    effort=80.0,
    command=Command(
        help="Least-squares fit of the vehicle model to all bump runs.",
        show=show_fit,
        next=("sample",),
        fault=lambda kept: None if kept.fit.converged else NotConvergedError,
    ),
)


# ---------------------------------------------------------------------- left_out


def _left_out(context: Context, runs: Sequence[str]) -> Iterator[tuple[str, LeftOutRun]]:
    from sysid.validation.leave_out import leave_out

    options = context.settings.fit
    for left in leave_out(context[FIT].fit, fit_state(context), runs, options, context.progress):
        yield left.run, left


def _runs(context: Context) -> Sequence[str]:
    """All runs, or the named ones, or none if no option requests any."""
    from sysid.validation.chosen_runs import chosen_runs

    named = tuple(context.options.get("left_out") or ())
    one_by_one = bool(context.options.get("leave_one_out"))
    files = [run.log.file for run in context.campaign.bump_runs]
    return chosen_runs(files, () if one_by_one else named) if one_by_one or named else ()


LEFT_OUT = Itemwise(
    name="left_out",
    chosen=_runs,
    each=_left_out,
    needs=(SCAN, FIT),
    settings=("fit",),
    code=("validation",),
    # They are shown with the agreement of the fitted runs.
    put=lambda results, left: results,
    effort=60.0,
)


# ---------------------------------------------------------------------- validate


def _validate(context: Context) -> Validation:
    from sysid.validation.agreement import validate
    from sysid.validation.channel_agreement import LeftOut

    fit = context[FIT].fit
    validation = validate(fit, context.settings.validation)
    kept = context.known(LEFT_OUT) or {}
    left = tuple(kept[h.file] for h in fit.histories if h.file in kept)
    return replace(validation, left_out=LeftOut(fit.names, left, validation.channels)) if left else validation


def show_validate(validation: Validation, results: Results) -> Blocks:
    """Medians over the channels of every run, with the run in the fit and without it."""
    left = {} if validation.left_out is None else {run.run: run for run in validation.left_out.runs}
    head = ("run", "residual / noise", "NRMSE", "R")
    table = TextTable(
        "Agreement, medians over channels", head + (tuple(f"without it: {h}" for h in head[1:]) if left else ())
    )
    for run in dict.fromkeys(row.run for row in validation.channels):
        cells = _medians([row for row in validation.channels if row.run == run])
        if left:
            cells += _medians(left[run].channels) if run in left else ("-",) * 3
        table.add_row(run, *cells)
    yield table
    yield f"{len(validation.outside)} of {len(validation.channels)} fitted channels are outside a limit."
    for other in left.values():
        if not other.converged:
            yield f"The fit without {other.run} did not end at a minimum."


def _medians(rows: Sequence[ChannelAgreement]) -> tuple[str, ...]:
    from sysid.validation.channel_agreement import channel_median

    digits = {"residual_over_noise": ".2f", "nrmse": ".2%", "iso18571": ".3f"}
    return tuple(finite_cell(channel_median(rows, name), how) for name, how in digits.items())


def _refuse_runs(declared: Declared, options: Mapping[str, Any]) -> None:
    from sysid.validation.chosen_runs import chosen_runs

    files = [run.file for run in declared.tables.tests.bump_run if run.file is not None]
    # A run of several loggers is named by their files together, when they have been read.
    if options.get("left_out") and len(files) == len(declared.tables.tests.bump_run):
        chosen_runs(files, options["left_out"])


VALIDATE = Whole(
    name="validate",
    compute=_validate,
    needs=(FIT,),
    uses=(LEFT_OUT,),
    settings=("validation",),
    code=("validation",),
    # Seconds, and in memory only as long as the fit.
    in_file=False,
    put=lambda results, validation: replace(results, validation=validation),
    command=Command(
        help="Agreement with the measured histories. With --leave-out also of runs that the fit has not seen.",
        show=show_validate,
        refuse=_refuse_runs,
        recalls=True,
        options=(
            Option(
                "--leave-out", "Predict this run (its file) by a fit of all others; may be repeated.", "left_out",
                multiple=True, metavar="RUN",
            ),
            Option("--leave-one-out", "Predict every run, each by a fit of all others.", "leave_one_out", kind=bool),
        ),
    ),
)  # fmt: skip


# ---------------------------------------------------------------------- profile


def _profiles(context: Context, names: Sequence[str]) -> Iterator[tuple[str, ProfileLikelihood]]:
    from sysid.estimation.fit.profiles import profile_parameter

    fit, state = context[FIT].fit, fit_state(context)
    for name in names:
        yield name, profile_parameter(state, fit, name, progress=context.progress)


def _refuse_parameters(declared: Declared, options: Mapping[str, Any]) -> None:
    axles = len(declared.vehicle.vehicle.axles)
    for name in options["profiled"]:
        axle = re.search(r"_(\d+)(\[|$)", name)
        if axle is not None and not 1 <= int(axle[1]) <= axles:
            raise CampaignError(f"The fit has no parameter '{name}': the vehicle has the axles 1 to {axles}.")


def _profiled(context: Context) -> Sequence[str]:
    from sysid.wording import finish, nearest

    names = context[FIT].fit.names
    chosen: list[str] = []
    for name in context.options.get("profiled") or ():
        # k_3 stands for the stiffness of axle 3 in every load case.
        matching = [n for n in names if n == name or n.startswith(f"{name}[")]
        if not matching:
            raise CampaignError(finish(f"The fit has no parameter '{name}'; {nearest(name, names)}"))
        chosen += matching
    return tuple(dict.fromkeys(chosen))


def show_profile(profiled: Mapping[str, ProfileLikelihood], results: Results) -> Blocks:
    """Deviance over value of every profiled parameter, and both intervals."""
    for p in profiled.values():
        factor, unit = shown_unit(p.unit)
        table = TextTable(f"Profile of {p.name}", ("value", "unit", "deviance", "adjusted", "converged"))
        for value, deviance, adjusted, converged in zip(p.value, p.deviance, p.adjusted, p.converged, strict=True):
            table.add_row(
                f"{value * factor:.5g}", unit, f"{deviance:.4g}", f"{adjusted:.3f}", "yes" if converged else "no"
            )
        yield table
        for what, (low, high) in (("likelihood ratio", p.interval), ("covariance", p.covariance_interval)):
            ends = [f"{end * factor:.5g}" if end == end else "open" for end in (low, high)]
            yield f"90 % interval by {what}: {ends[0]} to {ends[1]} {unit}"
        yield p.message


PROFILE = Itemwise(
    name="profile",
    chosen=_profiled,
    each=_profiles,
    needs=(SCAN, FIT),
    code=("estimation",),
    put=lambda results, profiles: replace(results, profiles=tuple(profiles.values())),
    effort=120.0,
    command=Command(
        help="Deviance over chosen parameters, all others optimised anew.",
        show=show_profile,
        refuse=_refuse_parameters,
        recalls=True,
        options=(
            Option(
                "--parameter", "Parameter by its name in the fit, for example k_3; may be repeated.", "profiled",
                multiple=True, required=True,
            ),
        ),
    ),
)  # fmt: skip
