"""Families of suspension laws: which elements are tried, and which are added or removed together."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.campaign.vehicle_records import Axle

#: Stops whose travels nobody declared.
STOPS = "estimated_bump_stops"
#: Dampers as they are tried first, and without their knees.
KNEED, BILINEAR = "asymmetric_damper", "bilinear_damper"
#: Leaves that act from a compression on, and friction as a force and as leaf packs have it.
HELPER, FRICTION, LEAF_FRICTION = "helper_spring", "friction", "leaf_friction"
Laws = tuple[frozenset[str], ...]
#: Elements worth trying on an axle without a declared law, by the kind of its suspension.
CANDIDATES = {
    "leaf": frozenset({FRICTION, LEAF_FRICTION, HELPER, KNEED}),
    "air": frozenset({FRICTION, "gas_spring", KNEED}),
    "other": frozenset({FRICTION, HELPER, KNEED}),
}

#: What is removed at a time: an element of all axles of one kind of suspension.
FAMILIES = (
    (LEAF_FRICTION, "leaf"),
    (FRICTION, "air"),
    (FRICTION, "other"),
    (FRICTION, "leaf"),
    (KNEED, "air"),
    (KNEED, "other"),
    (KNEED, "leaf"),
    ("gas_spring", "air"),
    (HELPER, "other"),
    (HELPER, "leaf"),
    (STOPS, "air"),
    (STOPS, "other"),
    (STOPS, "leaf"),
)
#: What is removed at a time of dampers that have lost their knees.
BILINEAR_FAMILIES = ((BILINEAR, "air"), (BILINEAR, "other"), (BILINEAR, "leaf"))


def richest_laws(axles: Sequence[Axle], declared: Laws) -> Laws:
    """The candidates of every axle without a declared law; the declared law of all others."""
    return tuple(
        law
        if axle.suspension_law is not None
        else law | CANDIDATES[axle.suspension] | (frozenset() if axle.has_stops else {STOPS})
        for axle, law in zip(axles, declared, strict=True)
    )


def without_family(axles: Sequence[Axle], laws: Laws, declared: Laws, family: tuple[str, str]) -> Laws:
    """The laws without an element on the axles of one kind of suspension, unless it is declared there."""
    element, suspension = family
    return tuple(
        law - ({element} - given) if axle.suspension == suspension else law
        for axle, law, given in zip(axles, laws, declared, strict=True)
    )


def without_knees(laws: Laws, declared: Laws) -> Laws:
    """The laws with bilinear dampers in place of those with a knee, unless these are declared.

    All of them at a time: axles share the shape of the knee and the slope beyond it.
    """
    return tuple(
        law - {KNEED} | {BILINEAR} if KNEED in law - given else law for law, given in zip(laws, declared, strict=True)
    )


def with_elements(laws: Laws, added: Laws) -> Laws:
    """The laws with further elements; friction of leaf packs takes the place of friction as a force."""
    return tuple(
        (law | more) - ({FRICTION} if LEAF_FRICTION in law | more else frozenset())
        for law, more in zip(laws, added, strict=True)
    )


def with_plain_friction(laws: Laws, declared: Laws) -> Laws:
    """The laws with friction as a force in place of that of leaf packs, unless this is declared."""
    return tuple(
        law - {LEAF_FRICTION} | {FRICTION} if LEAF_FRICTION in law - given else law
        for law, given in zip(laws, declared, strict=True)
    )
