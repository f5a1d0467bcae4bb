"""Elements that a suspension law is made of, and the parameters with which each enters the calibration.

A law is written in the campaign file as ``linear`` or as elements joined by ``+``, for example
``friction + asymmetric_damper``; spring and viscous damper are always there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sysid.campaign.vehicle_records import Axle
from sysid.vehicle_model.device_arrays import HostOrDevice

LINEAR = "linear"


@dataclass(frozen=True)
class ElementQuantity:
    """One parameter of an element.

    - `shared`: whether it is one parameter for all axles that have the element;
    - `median` gives the prior median from an axle and the static load its suspension carries [N], `sd` is the prior's
      standard deviation of the logarithm;
    - `neutral` is the value with which the element has no effect on an axle.

    - `field` is the coefficient of :class:`sysid.vehicle_model.suspension.SuspensionLaw` that it sets, None if it sets
      corners of a curve (:mod:`sysid.estimation.parameters.suspension_curves`);
    - `coefficient` computes that coefficient from four numbers: its value, the stiffness [N/m], the load that the
      suspension carries [N], and that load over the one in the first load case. None means the value itself;
    - `decides`: whether the element acts only if this value is not the neutral one.
    """

    quantity: str
    symbol: str
    unit: str
    shared: bool
    median: Callable[[Axle, float], float]
    sd: float
    neutral: float
    field: str | None = None
    coefficient: Callable[[HostOrDevice, HostOrDevice, HostOrDevice, HostOrDevice], HostOrDevice] | None = None
    decides: bool = True


@dataclass(frozen=True)
class Element:
    """A named part of a suspension law with its parameters."""

    name: str
    meaning: str
    quantities: tuple[ElementQuantity, ...]


#: Assumed share of a bellows' pressure stiffness that its progressivity shows: auxiliary volumes and rubber leave less
#: than the 1 of a closed isothermal volume; the wide prior leaves room for either.
PROGRESSIVITY = 0.4
#: Assumed share of k e by which the ends of a bellows, where it widens, raise the force at this stroke (0.02 to 1).
STROKE_STIFFENING, STIFFENING_STROKE_M = 0.15, 0.1
#: Assumed stiffness of a pair of rubber stops where they begin to act [N/m]; they stiffen as they are compressed.
STOP_STIFFNESS = 2e6
#: Travel to the stops from rest [m], median and standard deviation of the logarithm, where nobody declares it: trucks
#: have 60 to 90 mm in jounce and 70 to 95 mm in rebound (general knowledge), air springs rather more than leaf packs.
JOUNCE_TRAVEL_M = {"leaf": 0.070, "air": 0.080, "other": 0.075}
REBOUND_TRAVEL_M = {"leaf": 0.078, "air": 0.085, "other": 0.082}
TRAVEL_SD = 0.12
#: Travels that are estimated with undeclared stops.
TRAVELS = ("jounce_travel", "rebound_travel")
#: Travel of an axle without stops: longer than any.
NO_STOP_M = 1e3
#: Share of the carried load at which leaf packs (air-sprung and other axles) rub: assumptions inside the 2 to 10 % that
#: are generally known of leaf packs.
FRICTION_SHARE = {"leaf": 0.05, "air": 0.02, "other": 0.03}

#: Stiffness [N/m] of the helper leaves of an axle, compression [m] from rest in the first load case from which on they
#: act, and the standard deviation of both logarithms. Assumptions: helpers are about as stiff as the main leaves, and
#: are to act under load, not on the empty truck.
GENERIC_HELPER_STIFFNESS, HELPER_TRAVEL_M, HELPER_SD = 8.0e5, 0.03, 0.8
#: Stiffness [N/m] of the bushings of an axle's two dampers, an eye at each end of both, and the standard deviation of
#: its logarithm: 2 to 20 MN/m from eyes of 2 to 20 kN/mm (an assumption: general knowledge of rubber in shock absorbers
#: of trucks).
BUSHING_STIFFNESS, BUSHING_SD = 6.0e6, 0.7
#: Of friction between leaves: share of a change of the load on them that it follows, friction of fast sliding over that
#: of the breakaway, and the rate [m/s] at which it is half way between. Assumptions: dry friction is proportional to
#: what presses the leaves together, but clips and centre bolts press them too; steel on steel slides with 0.6 to 1 of
#: the friction at which it breaks away (general knowledge).
FRICTION_GROWTH, SLIDING_SHARE, SLIDING_RATE_M_S = 0.5, 0.8, 0.1

_FRICTION = ElementQuantity(
    "friction",
    "F",
    "N",
    False,
    lambda axle, carried: FRICTION_SHARE[axle.suspension] * carried,
    1.0,
    0.0,
    "friction",
    # Leaves and bushings rub in proportion to what they carry: one number for all load cases.
    lambda friction, stiffness, carried, growth: friction * growth,
)
_SLIP = ElementQuantity("slip_length", "slip", "m", True, lambda axle, carried: 1e-3, 0.7, 1.0, "slip", decides=False)
_ASYMMETRY = ElementQuantity("damper_asymmetry", "q", "1", False, lambda axle, carried: 1.5, 0.7, 1.0, "asymmetry")
_STOP = ElementQuantity("stop_stiffness", "stop", "N/m", False, lambda axle, carried: STOP_STIFFNESS, 0.7, 0.0)


def _travel(quantity: str, symbol: str, medians: Mapping[str, float]) -> ElementQuantity:
    def median(axle: Axle, carried: float) -> float:
        return medians[axle.suspension]

    return ElementQuantity(quantity, symbol, "m", False, median, TRAVEL_SD, NO_STOP_M, decides=False)


ELEMENTS = {
    element.name: element
    for element in (
        Element(
            "friction",
            "Coulomb friction between leaves or in bushings (Dahl)",
            (
                _FRICTION,
                _SLIP,
            ),
        ),
        Element(
            "leaf_friction",
            "friction that grows with what presses leaves together, and falls as they slide faster",
            (
                _FRICTION,
                _SLIP,
                ElementQuantity(
                    "friction_growth",
                    "growth",
                    "1",
                    True,
                    lambda axle, carried: FRICTION_GROWTH,
                    0.7,
                    0.0,
                    "friction_growth",
                    lambda share, stiffness, carried, growth: share * stiffness / carried,
                ),
                ElementQuantity(
                    "sliding_share", "sliding", "1", True, lambda axle, carried: SLIDING_SHARE, 0.3, 1.0, "sliding"
                ),
                ElementQuantity(
                    "sliding_rate",
                    "sliding_rate",
                    "m/s",
                    True,
                    lambda axle, carried: SLIDING_RATE_M_S,
                    1.0,
                    1.0,
                    "sliding_rate",
                    decides=False,
                ),
            ),
        ),
        Element(
            "damper_bushing",
            "rubber bushings in series with the dampers",
            (
                ElementQuantity(
                    "bushing_stiffness",
                    "bushing",
                    "N/m",
                    False,
                    lambda axle, carried: BUSHING_STIFFNESS,
                    BUSHING_SD,
                    math.inf,
                    "compliance",
                    lambda bushing, stiffness, carried, growth: 1.0 / bushing,
                ),
            ),
        ),
        Element(
            "asymmetric_damper",
            "damper with different rebound and compression and a knee",
            (
                _ASYMMETRY,
                ElementQuantity(
                    "damper_knee",
                    "knee",
                    "m/s",
                    False,
                    lambda axle, carried: 0.6,
                    0.8,
                    1.0,
                    "saturation",
                    decides=False,
                ),
                ElementQuantity(
                    "damper_rounding",
                    "rounding",
                    "1",
                    True,
                    lambda axle, carried: 0.5,
                    1.0,
                    1.0,
                    "rounding",
                    decides=False,
                ),
                # Axles without the element have a tail of one, which makes the damper linear.
                ElementQuantity("damper_tail", "tail", "1", True, lambda axle, carried: 0.2, 1.0, 1.0, "tail"),
            ),
        ),
        Element(
            "bilinear_damper", "damper with different rates in rebound and compression, without a knee", (_ASYMMETRY,)
        ),
        Element(
            "gas_spring",
            "air spring that stiffens when compressed",
            (
                ElementQuantity(
                    "progressivity",
                    "progressivity",
                    "1",
                    True,
                    lambda axle, carried: PROGRESSIVITY,
                    1.0,
                    0.0,
                    "softening",
                    lambda progressivity, stiffness, carried, growth: progressivity * stiffness / carried,
                ),
                ElementQuantity(
                    "stroke_stiffening",
                    "stiffening",
                    "1",
                    True,
                    lambda axle, carried: STROKE_STIFFENING,
                    1.2,
                    0.0,
                    "stiffening",
                    lambda share, stiffness, carried, growth: share / STIFFENING_STROKE_M**2,
                ),
            ),
        ),
        Element(
            "helper_spring",
            "helper leaves that act from a compression on",
            (
                ElementQuantity(
                    "helper_stiffness",
                    "helper",
                    "N/m",
                    False,
                    lambda axle, carried: GENERIC_HELPER_STIFFNESS,
                    HELPER_SD,
                    0.0,
                ),
                ElementQuantity(
                    "helper_travel",
                    "helper_travel",
                    "m",
                    False,
                    lambda axle, carried: HELPER_TRAVEL_M,
                    HELPER_SD,
                    NO_STOP_M,
                    decides=False,
                ),
            ),
        ),
        Element(
            "bump_stops",
            "stops at the end of the declared jounce and rebound travel, on every axle that declares one",
            (_STOP,),
        ),
        Element(
            "estimated_bump_stops",
            "stops at the end of travels that nobody declared",
            (
                _STOP,
                _travel("jounce_travel", "jounce", JOUNCE_TRAVEL_M),
                _travel("rebound_travel", "rebound", REBOUND_TRAVEL_M),
            ),
        ),
        Element("hanger_lash", "free travel between leaf pack and hanger, as declared", ()),
        Element("spring_table", "force-extension table, scaled by the stiffness", ()),
        Element("damper_table", "force-rate table, scaled by the damping", ()),
    )
}


def law_elements(law: str | None) -> frozenset[str]:
    """Elements of a law as written in the campaign file; None and ``linear`` have none.

    Raises
    ------
    ValueError
        If a part is not the name of an element; the message is that part.
    """
    parts = {part.strip() for part in (law or LINEAR).split("+")}
    for part in sorted(parts - {LINEAR}):
        if part not in ELEMENTS:
            raise ValueError(part)
    return frozenset(parts - {LINEAR})


def law_name(elements: frozenset[str]) -> str:
    """The law as written in the campaign file."""
    return " + ".join(name for name in ELEMENTS if name in elements) or LINEAR


def quantities(elements: frozenset[str]) -> list[ElementQuantity]:
    """Parameters of all elements of a law; what two elements share counts once."""
    return list(dict.fromkeys(q for name, element in ELEMENTS.items() if name in elements for q in element.quantities))


def coefficients() -> list[ElementQuantity]:
    """Parameters of all elements that are coefficients of the suspension law."""
    return [q for q in quantities(frozenset(ELEMENTS)) if q.field is not None]
