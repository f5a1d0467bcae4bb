"""Whether every prior of the campaign file belongs to a parameter that a fit of the campaign may have."""

from __future__ import annotations

from sysid.campaign.records import Campaign
from sysid.estimation.parameters.campaign_parameters import campaign_parameters, declared_laws
from sysid.estimation.parameters.law_families import richest_laws
from sysid.estimation.parameters.named_priors import check_named_priors


def check_priors(campaign: Campaign) -> None:
    """Refuse priors of parameters that neither the declared laws nor the richest candidates have.

    Raises
    ------
    CampaignError
        As :func:`sysid.estimation.parameters.named_priors.check_named_priors`.
    """
    if not campaign.priors:
        return
    declared = declared_laws(campaign)
    rich = richest_laws(campaign.vehicle.axles, declared)
    sets = [campaign_parameters(campaign, None, laws) for laws in (declared, rich)]
    check_named_priors(campaign, [p for parameters in sets for p in parameters.parameters])
