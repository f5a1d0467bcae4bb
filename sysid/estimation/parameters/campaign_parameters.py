"""Parameters of a campaign: start values and priors from drops, nominal values and the user.

:mod:`sysid.estimation.parameters.axle_laws` says where each parameter enters the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.campaign.priors import PriorOverride
from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Axle, LeafDimensions, Vehicle
from sysid.errors import CampaignError
from sysid.estimation.parameters.named_priors import with_named_priors
from sysid.estimation.parameters.parameter_set import (
    BENDING_DAMPING,
    BENDING_FREQUENCY,
    SHARE_ODDS,
    Parameter,
    ParameterSet,
    PriorLink,
    bending_names,
)
from sysid.estimation.parameters.rockers import share_name
from sysid.estimation.parameters.suspension_elements import ELEMENTS, LINEAR, law_elements, law_name, quantities
from sysid.sdof.drop_results import DropEstimate, DropSummary

#: Generic lognormal priors (median, log sd), used without a drop or a prior of the user; per axle, both sides.
#: Assumptions: general knowledge of heavy vehicles, wide enough for steer and trailer axles, empty and laden.
GENERIC_STIFFNESS = {"leaf": (1.0e6, 0.8), "air": (3.5e5, 0.7), "other": (7.0e5, 0.9)}
GENERIC_DAMPING = (1.2e4, 0.8)
#: Spread of the log of k and c around a drop estimate: axle coupling and the tire in series bias drops this much.
#: The tire alone leaves 1/(1 + k/kt) of k and its square of c: 0.6 to 0.8 and 0.4 to 0.6 at usual ratios k/kt.
DROP_STIFFNESS_SD = 0.4
DROP_DAMPING_SD = 0.7
#: Spread of data-book tire values, and the exponent of the tire's load-deflection law (1 linear, 1.5 radial springs).
#: Assumptions: data books state neither their spread nor, mostly, the load that a stiffness belongs to.
TIRE_STIFFNESS_SD = 0.10
TIRE_DAMPING_SD = 0.5
TIRE_EXPONENT = (1.2, 0.08)
#: Exponent with which an air spring's stiffness follows the load it carries, and its standard deviation (general
#: knowledge: 0.6 to 1 with levelling valves, which keep the height, so that the pressure rises with the load while the
#: volume stays).  Wide enough for springs of constant pressure, whose exponent is 0: a narrower one pulls their k.
AIR_LOAD_EXPONENT = (0.7, 0.35)
#: Smallest standard deviation of such a link, for load cases of nearly the same load.
AIR_LINK_LEAST_SD = 0.05

#: Odds s / (1 - s) of a rocker's load share and their log sd: half shared, and 95 % of the prior from 0.02 to 0.98. So
#: only the data determine how much load is shared in spite of friction in the rocker (an assumption).
SHARE_ODDS_PRIOR = (1.0, 2.0)

#: Spread of the logarithm of the damping ratio of a frame that bends: known to a factor of less than two (an
#: assumption).
BENDING_DAMPING_SD = 0.5

#: Young's modulus of spring steel [Pa] (material data), and the spread of the leaf formula about real packs, an
#: assumption: clamped length, full-length leaves and shackles.
SPRING_STEEL_PA = 2.06e11
LEAF_FORMULA_SD = 0.3

METHOD_PREFERENCE = ("model", "free_decay", "corrected", "paper")
#: In the full model friction and tire law are uncertain, but not the coupling of the axles: half of the spread above,
#: an assumption.
MODEL_STIFFNESS_SD = 0.2
MODEL_DAMPING_SD = 0.4
#: The same where linear laws do not explain the drops: dry friction raises the k of small swings, and c holds all of
#: it, up to ten times the viscous part on leaf packs (an assumption; seen with friction of 5 to 7 % of the load).
DOUBTFUL_STIFFNESS_SD = 0.4
DOUBTFUL_DAMPING_SD = 1.0


def declared_laws(campaign: Campaign) -> tuple[frozenset[str], ...]:
    """Elements of every axle's suspension law as the campaign file declares them; no law is a linear one.

    An axle with a declared travel has bump stops, whatever its law says.

    Raises
    ------
    CampaignError
        If an axle asks for a suspension law that is not available.
    """
    laws = []
    for axle in campaign.vehicle.axles:
        try:
            law = law_elements(axle.suspension_law)
        except ValueError as error:
            raise CampaignError(
                f"{campaign.file.name}: axle '{axle.name}' asks for suspension_law = '{axle.suspension_law}'; "
                f"'{error}' is unknown, give '{LINEAR}' or elements joined by '+': {', '.join(ELEMENTS)}."
            ) from error
        laws.append(law | {"bump_stops"} if axle.has_stops else law)
    return tuple(laws)


def campaign_parameters(
    campaign: Campaign, drops: DropSummary | None, laws: Sequence[frozenset[str]] | None = None
) -> ParameterSet:
    """Parameters of a campaign with start values and priors from drops, nominal tire values and the user.

    Parameters
    ----------
    laws : elements of every axle's suspension law, None for those of the campaign file.

    Raises
    ------
    CampaignError
        If an axle asks for a suspension law that is not available.
    """
    laws = declared_laws(campaign) if laws is None else laws
    vehicle = campaign.vehicle
    first = next(iter(campaign.load_cases))
    suspended = sorted(set(vehicle.suspension_axle))
    parameters, links = _stiffness_parameters(campaign, drops, laws)
    for i in suspended:
        parameters.append(replace(_suspension_parameter(vehicle, i, "damping", drops, first), law=law_name(laws[i])))
    parameters += _element_parameters(campaign, laws)
    parameters += _frame_parameters(vehicle)
    for i, axle in enumerate(vehicle.axles):
        median, sd = _override(axle, "tire_stiffness", axle.tire_stiffness_N_per_m, TIRE_STIFFNESS_SD)
        parameters.append(Parameter(f"kt_{i + 1}", "tire_stiffness", "N/m", median, median, sd, axle=i))
    for i, axle in enumerate(vehicle.axles):
        median, sd = _override(axle, "tire_damping", max(axle.tire_damping_N_s_per_m, 500.0), TIRE_DAMPING_SD)
        parameters.append(Parameter(f"ct_{i + 1}", "tire_damping", "N s/m", median, median, sd, axle=i))
    median, sd = TIRE_EXPONENT
    parameters.append(Parameter("tire_exponent", "tire_exponent", "1", median, median, sd))
    return ParameterSet(*with_named_priors(parameters, links, campaign.priors), vehicle.suspension_axle)


def _stiffness_parameters(
    campaign: Campaign, drops: DropSummary | None, laws: Sequence[frozenset[str]]
) -> tuple[list[Parameter], list[PriorLink]]:
    """One stiffness per suspension; for air springs one per load case, linked by the loads.

    If only one of several load cases is in use, its air springs have no other name, but are those of this case alone.
    """
    vehicle = campaign.vehicle
    # A load case that is only predicted has its own air-spring stiffness too: known through its link alone.
    used_cases = campaign.load_cases_in_use
    first = next(iter(campaign.load_cases))
    parameters: list[Parameter] = []
    links: list[PriorLink] = []
    suspended = sorted(set(vehicle.suspension_axle))
    for i in suspended:
        axle = vehicle.axles[i]
        stiffness = replace(_suspension_parameter(vehicle, i, "stiffness", drops, first), law=law_name(laws[i]))
        if axle.load_dependent and len(campaign.load_cases) > 1 and used_cases:
            # Drops and generic values belong to the first load case, whether or not a run was driven in it.
            growth = {case: _air_growth(campaign, i, first, case) for case in used_cases}
            base = used_cases[0]
            from_first = 0.0 if base == first else _link_sd(growth[base])
            for case in used_cases:
                rise = growth[case] - growth[base]
                sd = _link_sd(rise)
                factor = float(np.exp(growth[case]))
                name = stiffness.name if len(used_cases) == 1 else f"k_{i + 1}[{case}]"
                spread = from_first if case == base else float(np.hypot(from_first, sd))
                parameters.append(
                    replace(
                        stiffness,
                        name=name,
                        load_case=case,
                        start=stiffness.start * factor,
                        prior_median=stiffness.prior_median * factor,
                        prior_sd=float(np.hypot(stiffness.prior_sd, spread)),
                    )
                )
                if case != base:
                    links.append(PriorLink(f"k_{i + 1}[{base}]", name, rise, sd))
        else:
            parameters.append(stiffness)
    return parameters, links


def _frame_parameters(vehicle: Vehicle) -> list[Parameter]:
    """Shares of rockers that are not declared, and bending modes of frames."""
    median, sd = SHARE_ODDS_PRIOR
    parameters = [
        Parameter(share_name(rocker.name), SHARE_ODDS, "1", median, median, sd, axle=rocker.axles[0])
        for rocker in vehicle.equalisers
        if rocker.load_share is None
    ]
    for body in vehicle.bodies:
        if body.bending is not None:
            (hz, ratio), bent = bending_names(body.name), body.bending
            frequency, damping = bent.frequency_hz, bent.damping_ratio
            start = bent.start_hz or frequency
            parameters += [
                Parameter(hz, BENDING_FREQUENCY, "Hz", start, frequency, bent.frequency_sd),
                Parameter(ratio, BENDING_DAMPING, "1", damping, damping, BENDING_DAMPING_SD),
            ]
    return parameters


def _element_parameters(campaign: Campaign, laws: Sequence[frozenset[str]]) -> list[Parameter]:
    """Parameters of all other elements than spring and damper; a shared one has its prior from its first axle."""
    by_name: dict[str, Parameter] = {}
    vehicle, loads = campaign.vehicle, next(iter(campaign.load_cases.values())).axle_loads_kg
    for i in sorted(set(vehicle.suspension_axle)):
        axle = vehicle.axles[i]
        carried = sum(loads[j] - vehicle.unsprung_mass_kg[j] for j in _carried_by(vehicle, i)) * vehicle.gravity_m_s2
        for q in quantities(laws[i]):
            name = q.symbol if q.shared else f"{q.symbol}_{i + 1}"
            median = q.median(axle, carried)
            axle_index = None if q.shared else i
            law = law_name(laws[i])
            by_name.setdefault(name, Parameter(name, q.quantity, q.unit, median, median, q.sd, axle_index, law=law))
    return list(by_name.values())


def leaf_pack_stiffness(leaf: LeafDimensions) -> float:
    """Stiffness [N/m] of the leaf packs of both sides of an axle.

    A pack of n leaves of width b and thickness t, span L between the eyes, loaded at its middle, is a beam of uniform
    strength: k = 8 E n b t^3 / (3 L^3) (R. G. Budynas and J. K. Nisbett, Shigley's Mechanical Engineering Design,
    leaf springs); two packs carry an axle.
    """
    return 2.0 * 8.0 * SPRING_STEEL_PA * leaf.leaves * leaf.width_m * leaf.thickness_m**3 / (3.0 * leaf.length_m**3)


def _air_growth(campaign: Campaign, axle: int, first: str, case: str) -> float:
    """Logarithm by which an air spring is expected to be stiffer in `case` than in the first load case."""
    on = _carried_by(campaign.vehicle, axle)
    unsprung = sum(campaign.vehicle.unsprung_mass_kg[j] for j in on)
    carried = [sum(campaign.load_cases[name].axle_loads_kg[j] for j in on) - unsprung for name in (case, first)]
    return AIR_LOAD_EXPONENT[0] * float(np.log(carried[0] / carried[1]))


def _link_sd(rise: float) -> float:
    """Standard deviation of the logarithm by which an air spring is stiffer under a load than expected."""
    return max(AIR_LOAD_EXPONENT[1] * abs(rise) / AIR_LOAD_EXPONENT[0], AIR_LINK_LEAST_SD)


def _override(axle: Axle, quantity: str, median: float, sd: float) -> tuple[float, float]:
    prior: PriorOverride | None = axle.priors.get(quantity)
    return (median, sd) if prior is None else (prior.median, prior.log_sd)


def _carried_by(vehicle: Vehicle, axle: int) -> list[int]:
    """Axles under the suspension of an axle: itself, and the others of its group."""
    return [j for j, owner in enumerate(vehicle.suspension_axle) if owner == axle]


def _suspension_parameter(
    vehicle: Vehicle, i: int, quantity: str, drops: DropSummary | None, load_case: str
) -> Parameter:
    """k or c of one suspension: the user's prior first, then drops, then the generic range of its suspension type.

    Generic values and single-axle evaluations of drops are per axle: the suspension of a group is as stiff as those of
    its axles together.  The full model's estimate and a leaf pack's dimensions are the group's own.
    """
    axle, on = vehicle.axles[i], _carried_by(vehicle, i)
    if quantity == "stiffness":
        symbol, unit, spread = "k", "N/m", DROP_STIFFNESS_SD
        generic = GENERIC_STIFFNESS[axle.suspension]
    else:
        symbol, unit, spread = "c", "N s/m", DROP_DAMPING_SD
        generic = GENERIC_DAMPING
    by_axle = best_drop_estimates(drops, load_case)
    by_model = i in by_axle and by_axle[i].method == "model"
    if by_model and quantity == "damping" and by_axle[i].damping_sd >= DOUBTFUL_DAMPING_SD * by_axle[i].damping:
        by_axle = {}
    values = [
        getattr(by_axle[j], quantity) / (len(on) if by_model else 1) for j in ([i] if by_model else on) if j in by_axle
    ]
    if not values:
        median, sd = generic
    else:
        # A drop far outside the generic range (a wheel hop taken for the body) is pulled back towards it.
        limit = 2.0 * generic[1]
        shifts = np.clip(np.log(np.maximum(values, 1e-6 * generic[0]) / generic[0]), -limit, limit)
        median, sd = generic[0] * float(np.exp(shifts).mean()), spread
        if by_model:
            of = by_axle[i]
            own = (of.stiffness_sd / of.stiffness) if quantity == "stiffness" else (of.damping_sd / of.damping)
            sd = max(MODEL_STIFFNESS_SD if quantity == "stiffness" else MODEL_DAMPING_SD, own)
    median *= len(on)
    start = median
    if quantity == "stiffness" and axle.leaf is not None:
        median, sd = leaf_pack_stiffness(axle.leaf), LEAF_FORMULA_SD
        start = start if values else median
    if quantity in axle.priors:
        median, sd = _override(axle, quantity, median, sd)
        start = median
    return Parameter(f"{symbol}_{i + 1}", quantity, unit, start, median, sd, axle=i)


def best_drop_estimates(drops: DropSummary | None, load_case: str) -> Mapping[int, DropEstimate]:
    """The pooled drop estimate of each axle to start from: full model, else free decay, corrected, the paper's."""
    chosen: dict[int, DropEstimate] = {}
    if drops is None:
        return chosen
    for method in reversed(METHOD_PREFERENCE):
        for estimate in drops.pooled:
            if estimate.method != method or not estimate.usable or estimate.load_case != load_case:
                continue
            # A suspension with dry friction alone has no viscous damping.
            if estimate.stiffness > 0 and estimate.damping >= 0:
                chosen[estimate.axle] = estimate
    return chosen
