"""The user's own priors by the name of the parameter, from the table [priors] of the campaign file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.campaign.priors import NamedPrior
from sysid.campaign.records import Campaign
from sysid.errors import CampaignError
from sysid.estimation.parameters.parameter_set import Parameter, PriorLink
from sysid.wording import finish, nearest


def with_named_priors(
    parameters: Sequence[Parameter], links: Sequence[PriorLink], priors: Mapping[str, NamedPrior]
) -> tuple[tuple[Parameter, ...], tuple[PriorLink, ...]]:
    """Parameters and links with the user's priors, which are also where the search starts.

    A parameter with a prior of its own is linked to no other; those linked to it follow it. Names that are not among
    the parameters are ignored here: :func:`check_named_priors` checks them.
    """
    if not priors:
        return tuple(parameters), tuple(links)
    kept = tuple(link for link in links if link.second not in priors)
    by_name: dict[str, Parameter] = {}
    for p in parameters:
        prior = priors.get(p.name)
        by_name[p.name] = (
            p if prior is None else replace(p, start=prior.median, prior_median=prior.median, prior_sd=prior.log_sd)
        )
    for link in kept:
        if link.first in priors:
            first, factor = by_name[link.first], float(np.exp(link.mean))
            by_name[link.second] = replace(
                by_name[link.second],
                start=first.start * factor,
                prior_median=first.prior_median * factor,
                prior_sd=float(np.hypot(first.prior_sd, link.sd)),
            )
    return tuple(by_name.values()), kept


def check_named_priors(campaign: Campaign, parameters: Iterable[Parameter]) -> None:
    """Refuse priors of parameters that no fit of the campaign has, of the wrong unit, or given twice.

    Parameters
    ----------
    parameters : all that a fit of the campaign may have, under any suspension law it tries.

    Raises
    ------
    CampaignError
        With the nearest name, or the key of the right unit.
    """
    known = {p.name: p for p in parameters}
    for name, prior in campaign.priors.items():
        where = f"{campaign.file.name}: [priors] {name}"
        if name not in known:
            cases = [n for n in known if n.startswith(f"{name}[")]
            hint = f"give {' and '.join(cases)}" if cases else nearest(name, known)
            raise CampaignError(finish(f"{where} is not a parameter of this vehicle; {hint}"))
        p = known[name]
        if prior.unit != p.unit:
            key = "median" + ("" if p.unit == "1" else f"_{unit_key(p.unit)}")
            interval = key.replace("median", "interval90", 1)
            raise CampaignError(
                f"{where} is given in {prior.unit}, but its unit is {p.unit}; give {key} or {interval}."
            )
        if p.axle is not None and p.quantity in campaign.vehicle.axles[p.axle].priors:
            raise CampaignError(
                f"{where} is given twice, there and in 'priors' of axle '{campaign.vehicle.axles[p.axle].name}'; "
                "leave one out."
            )


def unit_key(unit: str) -> str:
    """A unit as it stands in the keys of the campaign file."""
    return unit.replace("/", "_per_").replace(" ", "_")
