"""Families of suspension laws: which elements are tried, and which are added or removed together."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.campaign.vehicle_records import Axle

#: Stops whose travels nobody declared.
STOPS = "estimated_bump_stops"
Laws = tuple[frozenset[str], ...]
#: Elements worth trying on an axle without a declared law, by the kind of its suspension.
CANDIDATES = {
    "leaf": frozenset({"friction", "asymmetric_damper"}),
    "air": frozenset({"friction", "gas_spring", "asymmetric_damper"}),
    "other": frozenset({"friction", "asymmetric_damper"}),
}

#: What is removed at a time: an element of all axles of one kind of suspension.
FAMILIES = (
    ("friction", "air"),
    ("friction", "other"),
    ("friction", "leaf"),
    ("asymmetric_damper", "air"),
    ("asymmetric_damper", "other"),
    ("asymmetric_damper", "leaf"),
    ("gas_spring", "air"),
    (STOPS, "air"),
    (STOPS, "other"),
    (STOPS, "leaf"),
)


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
