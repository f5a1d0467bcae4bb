"""The one place that converts units: what a file or key says into SI."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Literal

from sysid.campaign.wording import finish, nearest, shorten
from sysid.errors import CampaignError

if TYPE_CHECKING:
    import pint

Dimension = Literal["length", "acceleration", "speed", "angle", "pressure"]

# Spellings accepted in a campaign file and what pint calls them; 1 g is the standard gravity 9.80665 m/s2.
# A fixed list instead of free expressions: pint would read "g" as gram and "mg" as milligram.
_SPELLINGS: dict[str, dict[str, str]] = {
    "length": {
        "m": "metre",
        "dm": "decimetre",
        "cm": "centimetre",
        "mm": "millimetre",
        "um": "micrometre",
        "µm": "micrometre",
        "in": "inch",
        "ft": "foot",
    },
    "acceleration": {
        "m/s^2": "metre / second ** 2",
        "m/s2": "metre / second ** 2",
        "m/s²": "metre / second ** 2",
        "mm/s^2": "millimetre / second ** 2",
        "mm/s2": "millimetre / second ** 2",
        "cm/s^2": "centimetre / second ** 2",
        "cm/s2": "centimetre / second ** 2",
        "ft/s^2": "foot / second ** 2",
        "g": "standard_gravity",
        "mg": "0.001 * standard_gravity",
    },
    "speed": {"km/h": "kilometre / hour", "m/s": "metre / second"},
    "angle": {"deg": "degree", "rad": "radian"},
    "pressure": {"kPa": "kilopascal", "Pa": "pascal"},
}
_SI = {
    "length": "metre",
    "acceleration": "metre / second ** 2",
    "speed": "metre / second",
    "angle": "radian",
    "pressure": "pascal",
}


def unit_names(dimension: Dimension) -> tuple[str, ...]:
    """Names of the units that a campaign file may use for this dimension."""
    return tuple(_SPELLINGS[dimension])


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[float]:
    import pint

    return pint.UnitRegistry()


@lru_cache(maxsize=64)
def si_factor(unit: str, dimension: Dimension) -> float:
    """Factor that turns a value in `unit` into SI (m, m/s^2, m/s, rad, Pa).

    Parameters
    ----------
    unit
        One of `unit_names(dimension)`, e.g. ``mm``, ``g``, ``km/h``, ``deg``, ``kPa``.
    dimension
        What is measured.

    Raises
    ------
    CampaignError
        If the unit is not known for this dimension; the nearest one is named.
    """
    spelling = _SPELLINGS[dimension].get(unit.strip())
    if spelling is None:
        hint = nearest(unit, unit_names(dimension))
        raise CampaignError(finish(f"'{shorten(unit)}' is not a unit of {dimension}; {hint}"))
    return float(_registry()(spelling).to(_SI[dimension]).magnitude)


def speed_m_s(value_km_h: float) -> float:
    """Speed in m/s from km/h."""
    return value_km_h * si_factor("km/h", "speed")


def angle_rad(value_deg: float) -> float:
    """Angle in rad from degrees."""
    return value_deg * si_factor("deg", "angle")


def pressure_pa(value_kpa: float) -> float:
    """Pressure in Pa from kPa."""
    return value_kpa * si_factor("kPa", "pressure")
