"""The only place that converts units, from those of a file or key to SI."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from math import pi
from types import MappingProxyType
from typing import Literal

from sysid.errors import CampaignError
from sysid.wording import finish, nearest, shorten

Dimension = Literal["length", "acceleration", "speed", "angle", "angular rate", "pressure"]

#: 1 g as a unit (CGPM 1901); weights use the campaign's `gravity_m_s2`.
STANDARD_GRAVITY_M_S2 = 9.80665

_INCH_M, _FOOT_M, _DEGREE_RAD = 0.0254, 0.3048, pi / 180.0
#: Spellings accepted in a campaign file, and SI units in each. Inch, foot, mile and pound are exact since the
#: international yard and pound agreement of 1959, the nautical mile (of a knot) since 1929.
_IN_SI: Mapping[Dimension, Mapping[str, float]] = MappingProxyType(
    {
        "length": {
            "m": 1.0,
            "dm": 0.1,
            "cm": 0.01,
            "mm": 1e-3,
            "um": 1e-6,
            "µm": 1e-6,
            "in": _INCH_M,
            "ft": _FOOT_M,
        },
        "acceleration": {
            "m/s^2": 1.0,
            "m/s2": 1.0,
            "m/s²": 1.0,
            "mm/s^2": 1e-3,
            "mm/s2": 1e-3,
            "cm/s^2": 0.01,
            "cm/s2": 0.01,
            "ft/s^2": _FOOT_M,
            "g": STANDARD_GRAVITY_M_S2,
            "mg": 1e-3 * STANDARD_GRAVITY_M_S2,
        },
        "speed": {
            "km/h": 1.0 / 3.6,
            "m/s": 1.0,
            "mph": 1609.344 / 3600.0,
            "ft/s": _FOOT_M,
            "knot": 1852.0 / 3600.0,
        },
        "angle": {"deg": _DEGREE_RAD, "rad": 1.0},
        "angular rate": {
            "deg/s": _DEGREE_RAD,
            "°/s": _DEGREE_RAD,
            "rad/s": 1.0,
            "mrad/s": 1e-3,
        },
        "pressure": {
            "bar": 1e5,
            "kPa": 1e3,
            "MPa": 1e6,
            "psi": 0.45359237 * STANDARD_GRAVITY_M_S2 / _INCH_M**2,
            "mbar": 100.0,
            "Pa": 1.0,
        },
    }
)
#: Metres in units of length.
LENGTH_IN_M = _IN_SI["length"]


def unit_names(dimension: Dimension) -> tuple[str, ...]:
    """Names of the units that a campaign file may use for this dimension."""
    return tuple(_IN_SI[dimension])


def si_factor(unit: str, dimension: Dimension) -> float:
    """Factor that turns a value in `unit` into SI (m, m/s^2, m/s, rad, rad/s, Pa).

    Parameters
    ----------
    unit : one of `unit_names(dimension)`, e.g. ``mm``, ``g``, ``km/h``, ``deg``, ``kPa``.
    dimension : what is measured.

    Raises
    ------
    CampaignError
        If the unit is not known for this dimension; the nearest one is named.
    """
    factor = _IN_SI[dimension].get(unit.strip())
    if factor is None:
        hint = nearest(unit, unit_names(dimension))
        raise CampaignError(finish(f"'{shorten(unit)}' is not a unit of {dimension}; {hint}"))
    return factor


#: Names in files of quantities that are neither lengths nor accelerations, in small letters.
_OTHER = frozenset(
    """v volt volts mv millivolt uv mv/v a ma ampere ohm n kn newton newtons nm kg pa kpa mpa bar psi
    degc °c c k degf °f rpm 1/min hz deg degree degrees rad rad/s deg/s °/s m/s km/h kmh mph
    strain um/m microstrain ustrain""".split()  # noqa: SIM905
)
_WORDS = {
    **dict.fromkeys(("metre", "meter", "metres", "meters"), "m"),
    **dict.fromkeys(("centimetre", "centimeter", "centimetres", "centimeters"), "cm"),
    **dict.fromkeys(("millimetre", "millimeter", "millimetres", "millimeters"), "mm"),
    **dict.fromkeys(("inch", "inches", '"'), "in"),
    **dict.fromkeys(("foot", "feet"), "ft"),
    "gn": "g",
    "kmh": "km/h",
    "kph": "km/h",
    "mi/h": "mph",
    "knots": "knot",
    "kt": "knot",
    "kts": "knot",
    "dps": "deg/s",
    "degree/s": "deg/s",
    "degrees/s": "deg/s",
}
_AT_THE_END = re.compile(r"[\[(]\s*([^\[\]()]{2,20}?|[mg])\s*[\])]\s*$")
_DECORATION = {"²": "^2", "**": "^", "·": "", " ": "", "µ": "u", "μ": "u", "sec": "s"}


def contradiction(written: str | None, declared: str) -> str | None:
    """The unit that a file writes, where it cannot be the declared one; else None.

    An unknown unit is no contradiction.
    """
    if written is None:
        return None
    known = _known_units(_OF_SENSORS)
    plain = _plain(written)
    if plain in known:
        same = _size_of(*known[plain]) == _size_of(*known[_plain(declared)])
        return None if same else written
    return written if plain in _OTHER else None


def unit_in_brackets(name: str) -> str | None:
    """What stands in brackets at the end of the name of a column: its unit, if it is one.

    One letter may be a place, such as [V] for ``vorn``, unless it is m or g.
    """
    match = _AT_THE_END.search(name)
    return None if match is None else match[1]


def recognised_unit(
    written: str, dimensions: tuple[Dimension, ...] = ("length", "acceleration")
) -> tuple[str, Dimension] | None:
    """How a campaign file calls a unit of these dimensions that a file writes, and which it is; None for others."""
    return _known_units(dimensions).get(_plain(written))


def length_in_m(written: str) -> float | None:
    """Metres in a unit of length that a file writes, None where it is none."""
    unit = recognised_unit(written, ("length",))
    return LENGTH_IN_M[unit[0]] if unit is not None else None


def is_other_quantity(written: str) -> bool:
    """Whether a unit is that of a quantity that is neither a length nor an acceleration."""
    return _plain(written) in _OTHER


_OF_SENSORS: tuple[Dimension, ...] = ("length", "acceleration", "speed", "angular rate", "pressure")


@lru_cache(maxsize=8)
def _known_units(dimensions: tuple[Dimension, ...]) -> Mapping[str, tuple[str, Dimension]]:
    known: dict[str, tuple[str, Dimension]] = {}
    for dimension in dimensions:
        for spelling in _IN_SI[dimension]:
            known.setdefault(_plain(spelling), (spelling, dimension))
    return known | {name: known[unit] for name, unit in _WORDS.items() if unit in known}


def _size_of(unit: str, dimension: Dimension) -> tuple[Dimension, float]:
    return dimension, si_factor(unit, dimension)


def _plain(unit: str) -> str:
    """A unit in small letters, m/s^2 for its many spellings."""
    text = unit.strip().strip("[]()").casefold()
    for old, new in _DECORATION.items():
        text = text.replace(old, new)
    return re.sub(r"(?:/s/s|/s\^?2|s\^?-2)$", "/s^2", text)


def speed_m_s(value_km_h: float) -> float:
    """Speed in m/s from km/h."""
    return value_km_h * si_factor("km/h", "speed")


def angle_rad(value_deg: float) -> float:
    """Angle in rad from degrees."""
    return value_deg * si_factor("deg", "angle")


def pressure_pa(value_kpa: float) -> float:
    """Pressure in Pa from kPa."""
    return value_kpa * si_factor("kPa", "pressure")
