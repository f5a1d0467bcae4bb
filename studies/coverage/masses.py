"""The two-axle truck with masses, heights and axle loads off by their tolerances, which the fit integrates out."""

from __future__ import annotations

from studies.coverage import bump
from studies.coverage.shards import Record
from sysid.campaign.vehicle_records import MassTolerances

_SEED = 24


def replicate(number: int) -> Record:
    """One campaign with independent Gaussian noise."""
    planned = bump.plan(MassTolerances())
    return bump.ranks(number, planned, bump.instruments(planned), _SEED)
