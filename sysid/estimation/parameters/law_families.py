"""Families of suspension laws: which elements are tried, and which are added or removed together."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.campaign.vehicle_records import Axle

#: Stops whose travels nobody declared.
STOPS = "estimated_bump_stops"
#: Dampers as they are tried first, and without their knees.
KNEED, BILINEAR = "asymmetric_damper", "bilinear_damper"
Laws = tuple[frozenset[str], ...]
#: Elements worth trying on an axle without a declared law, by the kind of its suspension.
CANDIDATES = {
    "leaf": frozenset({"friction", KNEED}),
    "air": frozenset({"friction", "gas_spring", KNEED}),
    "other": frozenset({"friction", KNEED}),
}

#: What is removed at a time: an element of all axles of one kind of suspension.
FAMILIES = (
    ("friction", "air"),
    ("friction", "other"),
    ("friction", "leaf"),
    (KNEED, "air"),
    (KNEED, "other"),
    (KNEED, "leaf"),
    ("gas_spring", "air"),
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
