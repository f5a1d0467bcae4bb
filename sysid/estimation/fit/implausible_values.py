"""Values that no truck has, and values that contradict what was declared about them.

A law that the truck does not have can take the place of one that it has: friction that slips over metres is a spring.
Such a fit converges and its residuals may be small, but its k and c are those of another truck. So every parameter is
compared with its prior, in standard deviations of that prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.parameters.suspension_elements import ELEMENTS
from sysid.numbers import number

#: Of normal priors six values in a hundred thousand are further away.
FAR_SD = 4.0
#: Friction is no more than this share of the carried load: leaf packs of trucks have 2 to 15 %, so an assumption with
#: room to spare (measured packs: P. S. Fancher et al., Measurement and representation of the mechanical properties of
#: truck leaf springs, SAE 800905, 1980, doi:10.4271/800905).
MOST_FRICTION = 0.4
#: Friction that slips over more than this [m] is a spring over most of a suspension's stroke; leaf packs slip over some
#: millimetres.
LONGEST_SLIP_M = 0.05
#: Quantities without effect where they are small, or large: on that side of their prior they may be anything.
_NOTHING_BELOW = frozenset(
    {
        "friction",
        "slip_length",
        "friction_growth",
        "damper_rounding",
        "damper_tail",
        "progressivity",
        "stroke_stiffening",
    }
)
_NOTHING_ABOVE = frozenset({"damper_knee", "bushing_stiffness"})
#: Travels to stops and their stiffness are what the runs show of them.
_SEEN = frozenset({"stop_stiffness", "jounce_travel", "rebound_travel"})
_OF_ELEMENTS = frozenset(q.quantity for e in ELEMENTS.values() for q in e.quantities)
_INSTEAD = {
    "friction": "the spring may not be linear (two stages, helper leaves), or a part of the truck may not be declared",
    "slip_length": "friction that slips over so much is a spring: the spring may have two stages or helper leaves",
}


@dataclass(frozen=True)
class ImplausibleValues:
    """Sentences about values that no truck has, `impossible`, and about ones that `contradict` what was declared."""

    impossible: tuple[str, ...]
    contradict: tuple[str, ...]


def implausible_values(parameters: Sequence[ParameterEstimate], carried_N: Mapping[int, float]) -> ImplausibleValues:
    """Parameters that are further from their priors than chance, or beyond physical limits.

    Parameters
    ----------
    carried_N : load [N] that the suspension of an axle (index) carries in the first load case.
    """
    impossible, contradict = [], []
    for p in parameters:
        distance = math.log(p.value / p.prior_median) / p.prior_sd if p.prior_sd > 0.0 else 0.0
        counts = p.quantity not in _SEEN and not (
            (distance < 0.0 and p.quantity in _NOTHING_BELOW) or (distance > 0.0 and p.quantity in _NOTHING_ABOVE)
        )
        far = counts and abs(distance) > FAR_SD
        limit = _limit(p, carried_N)
        if limit or (far and p.quantity in _OF_ELEMENTS):
            instead = _INSTEAD.get(p.quantity, "the truck does something that this law imitates")
            said = limit or f"{number(abs(distance), 2)} standard deviations from what is usual"
            impossible.append(
                f"{p.name} = {number(p.value, 2)} {p.unit} is a value that no truck has ({said}): {instead}."
            )
        elif far:
            contradict.append(
                f"The data require {p.name} = {number(p.value, 3)} {p.unit}, {number(abs(distance), 2)} standard "
                f"deviations of its prior from {number(p.prior_median, 3)} {p.unit}. "
                "Check what was declared or dropped, or widen the prior."
            )
    return ImplausibleValues(tuple(impossible), tuple(contradict))


def _limit(p: ParameterEstimate, carried_N: Mapping[int, float]) -> str:
    """The physical limit that a value exceeds, in words; empty if none."""
    if p.quantity == "friction" and p.axle is not None and p.value > MOST_FRICTION * carried_N[p.axle]:
        return f"{number(p.value / carried_N[p.axle], 2)} times the load carried"
    if p.quantity == "slip_length" and p.value > LONGEST_SLIP_M:
        return "longer than the stroke of a suspension allows"
    return ""
