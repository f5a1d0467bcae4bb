"""Errors of declared masses and of the contact model, and how the estimates of the parameters go with them.

Two campaigns of one truck share these errors: masses that were declared once, the scale, the tires. With their log
factors and amplitudes y = sd z, about the optimum of parameters x,

    x | z ~ N(m + G (z - z_0), C - G Z G'),    z ~ N(z_0, Z),

C is the covariance of the parameters with all else integrated out, and G = cov(x, z) Z^-1. Model error and laws that
the data do not decide widen C, and have nothing to do with z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FurtherUnknown:
    """One error: its `kind`, and the place, counted from 0, to which it belongs.

    - `place`: index of the axle, body or beam, None for what all have in common;
    - `beam`: whether an unsprung mass is that of a beam;
    - `load_case`: None where all load cases share it;
    - `declared`: the value that it is an error of [SI], the tire's stiffness for departures, 1 for the scale itself;
    - `sd`: prior standard deviation of y.
    """

    kind: str
    place: int | None
    beam: bool
    load_case: str | None
    declared: float
    sd: float


@dataclass(frozen=True)
class FurtherUnknowns:
    """Errors z of unit prior variance beside p log parameters: `unknowns`, `estimate` z_0 (q,), `covariance` Z (q, q)
    and `sensitivity` G (p, q).
    """

    unknowns: tuple[FurtherUnknown, ...]
    estimate: np.ndarray
    covariance: np.ndarray
    sensitivity: np.ndarray
