"""The fit as users ask for it: suspension laws and undeclared parts that the data support.

Linear laws come first. If they leave residuals that undeclared rockers and bending frames may explain, these are
searched for (:mod:`sysid.estimation.fit.part_search`). Then richer laws are compared, if those may explain what is left
(:mod:`sysid.estimation.fit.law_comparison`).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Vehicle
from sysid.estimation.fit.causes import Cause, CauseKind, beside_mistakes
from sysid.estimation.fit.contact_trials import contact_trials
from sysid.estimation.fit.evaluation import evaluate_optimum
from sysid.estimation.fit.fit_result import FitResult, LawComparison
from sysid.estimation.fit.joint_optimum import joint_optimum
from sysid.estimation.fit.law_comparison import compare_laws
from sysid.estimation.fit.law_screen import largest_gain
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.likely_mistake import leaves_more_than_noise, likely_mistake
from sysid.estimation.fit.optimum import Optimum, worth_a_search
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.part_search import undeclared_parts
from sysid.estimation.fit.search_plan import Plan, before_joint, first_sight
from sysid.estimation.fit.state import FitState
from sysid.estimation.fit.thresholds import MISFIT
from sysid.estimation.fit.travel_scan import with_touched_stops
from sysid.estimation.fit.undecided_laws import WORDS
from sysid.estimation.parameters.campaign_parameters import campaign_parameters, declared_laws
from sysid.estimation.parameters.law_families import (
    BILINEAR,
    FRICTION,
    HELPER,
    KNEED,
    LEAF_FRICTION,
    STOPS,
    Laws,
    richest_laws,
)
from sysid.estimation.parameters.rockers import load_shares
from sysid.estimation.parameters.suspension_elements import law_elements
from sysid.estimation.parameters.undeclared_parts import NO_PARTS, UndeclaredParts, undeclared_frames
from sysid.numbers import listing
from sysid.progress import Progress, Series, unwatched
from sysid.road.road_profile import RoadProfile
from sysid.runtime import forget_compiled
from sysid.sdof.drop_results import DropSummary

#: Kind of what each undeclared element says of a truck.
CAUSES: dict[str, CauseKind] = {
    FRICTION: "friction",
    LEAF_FRICTION: "leaf",
    HELPER: "helper",
    KNEED: "damper",
    BILINEAR: "damper",
    "gas_spring": "air_spring",
    STOPS: "stops",
}


def fit_with_laws(
    campaign: Campaign,
    drops: DropSummary | None,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> tuple[FitResult, FitState]:
    """Least-squares calibration with declared suspension laws and parts, or with those that the data support.

    Linear laws come first. If they leave residuals that richer laws may explain
    (:func:`sysid.estimation.fit.optimum.worth_a_search`), or on request, axles without a declared law get further
    elements: those with a decisive expected gain, by a test on the present fit
    (:mod:`sysid.estimation.fit.law_screen`). Elements without which the criterion does not become worse are removed
    again, one element of one kind of suspension at a time. If a test shows clearly that an element is needed, no fit
    without it is made. Rockers and bending frames that explain the residuals better than any law are added before the
    laws are compared. If one is found only together with the laws, the comparison begins again with it.

    Parameters
    ----------
    campaign : screened campaign (quality check applied).
    drops, profiles : what the drops say, and the road profile of each bump.
    options, progress : settings, and a callback (message, fraction done).

    Raises
    ------
    CampaignError, DataRejectedError
        As :func:`sysid.estimation.fit.least_squares.fit_bump_runs`.
    """
    options, report = options or FitOptions(), Series(progress or unwatched)
    choice = _Choice(one_of_each(campaign) if options.preview else campaign, drops, profiles, options, report)
    choice, linear = choice.with_parts(choice.declared, choice.by_declared_laws(None))
    chosen, comparison = choice.chosen(linear)
    if options.preview:
        choice, chosen = choice.on_all_runs(campaign, chosen)
    elif chosen is not linear:
        later, again = choice.with_parts(laws_at_optimum(campaign.vehicle, chosen), chosen)
        if later is not choice:
            choice = later
            chosen, comparison = choice.chosen(again)
    campaign, parts = choice.campaign, choice.parts
    joint = joint_optimum(campaign, chosen, profiles, options, report)
    fit, state = evaluate_optimum(campaign, joint, options, report, comparison.undecided if comparison else ())
    state = replace(state, point=replace(state.point, parts=parts))
    added = {rocker.name for rocker in parts.rockers}
    rockers = tuple(s for s in load_shares(campaign.vehicle, fit.parameters) if s.name in added)
    frames = undeclared_frames(campaign.vehicle, parts, fit.parameters)
    # A good median hides what acts on few channels; parts of the data that disagree show it.
    doubted = any(part.forbids or part.scattered for part in fit.parts)
    # A preview has its own footprint maps and masses in the joint optimum alone: what these explain is no mistake.
    explained = options.preview and not leaves_more_than_noise(joint, whatever_left=doubted)
    mistakes = () if parts or explained else likely_mistake(campaign, chosen, whatever_left=doubted)
    trials = contact_trials(campaign, chosen, profiles, options, report) if options.contact_spread else ()
    fit = replace(
        fit,
        undeclared_rockers=rockers,
        undeclared_frames=frames,
        undeclared_drive=parts.drive,
        law_comparison=comparison,
        contact_trials=trials,
    )
    others = (*found_elements(campaign, chosen, declared_laws(campaign)), *fit.causes)
    causes = (*mistakes, *beside_mistakes(mistakes, others))
    left_out = {c.sentence for c in others if c not in causes}
    kept = (w for w in fit.warnings if w not in left_out)
    warnings = (*fit.proposals, *(m.sentence for m in mistakes), *kept)
    return replace(fit, warnings=warnings, causes=causes), state


@dataclass(frozen=True)
class _Choice:
    """Fits of one campaign by any laws; its vehicle has the `parts` that were added to the declared one."""

    campaign: Campaign
    drops: DropSummary | None
    profiles: Mapping[str, RoadProfile]
    options: FitOptions
    report: Progress
    parts: UndeclaredParts = NO_PARTS

    @property
    def declared(self) -> Laws:
        """Laws of the campaign file, of every axle."""
        return declared_laws(self.campaign)

    @property
    def richest(self) -> Laws:
        """The richest laws that are tried."""
        return richest_laws(self.campaign.vehicle.axles, self.declared)

    @property
    def is_open(self) -> bool:
        """Whether any law is left to the data."""
        return self.richest != self.declared and self.options.laws != "declared"

    def chosen(self, linear: Optimum) -> tuple[Optimum, LawComparison | None]:
        """The final optimum, and what was tried on the way from that of the declared laws."""
        if not self.is_open:
            return linear, None
        if self.options.laws != "compare" and not self._leaves_laws(linear):
            return linear if self.options.preview else self.fitted(self.declared, linear), None
        tried = partial(self.fitted, comparing=True)
        preview = self.options.preview
        return compare_laws(self.campaign, self.declared, self.richest, linear, tried, preview=preview)

    def _leaves_laws(self, linear: Optimum) -> bool:
        """Whether richer laws may explain the residuals by the declared ones."""
        if linear.misfit >= MISFIT:
            # Then the gain, which takes a second or two, does not matter.
            return True
        return worth_a_search(linear, largest_gain(self.campaign, self.declared, self.richest, linear))

    def by_declared_laws(self, near: Optimum | None) -> Optimum:
        """The optimum of the laws of the campaign file, good enough to judge its residuals where any law is open."""
        return self.fitted(self.declared, near, first_sight if self.is_open else before_joint)

    def with_parts(self, laws: Laws, optimum: Optimum) -> tuple[_Choice, Optimum]:
        """Fits with the undeclared parts that the residuals of an optimum require, with the one by declared laws.

        If no part is required, the same fits and the optimum itself.
        """
        parts, with_them = undeclared_parts(
            self.campaign,
            laws,
            optimum,
            self.drops,
            self.profiles,
            self.options,
            self.report,
            law_gain=lambda campaign, at: largest_gain(campaign, laws, self.richest, at) if self.is_open else 0.0,
        )
        if not parts:
            return self, optimum
        choice = replace(self, campaign=parts.in_campaign(self.campaign), parts=self.parts + parts)
        return choice, choice.by_declared_laws(with_them)

    def on_all_runs(self, campaign: Campaign, chosen: Optimum) -> tuple[_Choice, Optimum]:
        """Fits of all runs of a campaign, and their optimum with the laws and parts that were found on some of them."""
        if len(campaign.bump_runs) == len(self.campaign.bump_runs):
            return self, chosen
        choice = replace(self, campaign=self.parts.in_campaign(campaign))
        parameters = campaign_parameters(choice.campaign, self.drops, laws_at_optimum(campaign.vehicle, chosen))
        search = partial(optimise, choice.campaign, parameters, self.profiles, self.options, self.report)
        return choice, search(plan=first_sight, begin=chosen)

    def fitted(
        self, laws: Laws, near: Optimum | None, plan: Plan = before_joint, *, comparing: bool = False
    ) -> Optimum:
        """The optimum of some laws by the phases of a plan; `near` one of others to start from."""
        parameters = campaign_parameters(self.campaign, self.drops, laws)
        if near is not None and parameters.names != near.problem.model.parameters.names:
            # Functions compiled for other laws are not needed again; those of the reference engine take much memory.
            forget_compiled()
        report = self._comparing if comparing else self.report
        search = partial(optimise, self.campaign, parameters, self.profiles, self.options, report, plan=plan)
        found = search(near=near)
        phases = plan(self.options, near is not None)
        if not phases.scans_stops:
            return found
        touched = with_touched_stops(self.campaign, found, phases.end, report)
        # Its residuals, and so the weights under which laws are compared, are other ones.
        return found if touched is found else search(near=touched)

    def _comparing(self, message: str, fraction: float) -> None:
        self.report(f"comparing suspension laws, {message}", fraction)


def one_of_each(campaign: Campaign) -> Campaign:
    """A campaign with one run of each load case, bump and speed: repeats tell no more of the laws of a suspension.

    Of repeats, the one with most channels; of these the first.
    """
    runs = campaign.bump_runs
    kept: dict[Hashable, int] = {}
    for i, run in enumerate(runs):
        kind = run.load_case, run.bump, run.nominal_speed_m_s
        if kind not in kept or len(run.log.channels) > len(runs[kept[kind]].log.channels):
            kept[kind] = i
    return replace(campaign, bump_runs=tuple(runs[i] for i in sorted(kept.values())))


def found_elements(campaign: Campaign, optimum: Optimum, declared: Laws) -> tuple[Cause, ...]:
    """Elements of the laws of an optimum that the campaign file does not declare, each with its axles."""
    laws, owner = laws_at_optimum(campaign.vehicle, optimum), campaign.vehicle.suspension_axle
    suspended = sorted(set(owner))
    causes = []
    for element, kind in CAUSES.items():
        axles = [i for i in suspended if element in laws[i] - declared[i]]
        if axles:
            causes.append(
                Cause(
                    kind,
                    f"Much of what the records show comes from undeclared {WORDS[element]} (axles "
                    f"{listing([str(i + 1) for i in axles])}), which the model has; what is left may be more of it.",
                    modelled=True,
                )
            )
    return tuple(causes)


def laws_at_optimum(vehicle: Vehicle, optimum: Optimum) -> Laws:
    """Elements of every axle's suspension law at an optimum."""
    parameters = optimum.problem.model.parameters
    places = [parameters.index("damping", i) for i in range(len(vehicle.axles))]
    return tuple(law_elements(parameters.parameters[place].law) for place in places)


def laws_from_names(vehicle: Vehicle, laws: Sequence[str]) -> Laws:
    """Law of every axle from the laws of a fit's suspensions, front to rear; a group of axles has one suspension."""
    owner = vehicle.suspension_axle
    law_of = dict(zip(sorted(set(owner)), laws, strict=True))
    return tuple(law_elements(law_of[i]) for i in owner)
