"""Plank drops: the height of the fall, drops that are not alike, and drops of an axle that behaves like another one."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.campaign.records import Campaign
from sysid.cross_checks.force_balance import RunSpectra


def drop_complaints(campaign: Campaign, spectra: Sequence[RunSpectra]) -> list[str]:
    """Sentences about drops."""
    return []
