"""Priors that a user gives for single parameters."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PriorOverride:
    """A user's own lognormal prior: `median` in SI units and the multiplicative standard deviation `log_sd`."""

    median: float
    log_sd: float


@dataclass(frozen=True)
class NamedPrior:
    """A user's own lognormal prior of the parameter of that name: `median` in `unit`, multiplicative `log_sd`."""

    median: float
    log_sd: float
    unit: str
