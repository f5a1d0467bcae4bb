"""One unknown factor on a declared mass property."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MassFactor:
    """One factor: `quantity` of the axle, axle group or body with index `place`, in the named load cases.

    The factor on the scale belongs to no place: `place` is 0.

    `sd` standard deviation of its logarithm; `words` what it belongs to, for people; `load_case` None where it is
    shared by all load cases in use.  Unknowns of left and right (:mod:`sysid.estimation.residuals.side_unknowns`) are
    among them, some `of` one bump or sensor; most of them are no factors, but amounts that are normal about zero.
    """

    name: str
    quantity: str
    words: str
    place: int
    sd: float
    load_cases: tuple[str, ...]
    axle: int | None = None
    load_case: str | None = None
    of: str | None = None
