"""LS-DYNA keyword include: discrete springs and dampers with the calibrated values."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from sysid.wording import plain_line

if TYPE_CHECKING:
    from sysid.estimates.calibrated_elements import CalibratedSuspension, CalibratedVehicle
    from sysid.results.contents import Judgement

#: Identifiers of axle i (from 1) are _FIRST + 10 i and the following ones; _FIRST itself is the section.
_FIRST = 9000
#: Points into which LS-DYNA resamples a curve: 0.3 mm and 5 mm/s, so that the friction's ramp survives.
_RESAMPLED = 1201


def lsdyna_text(vehicle: CalibratedVehicle, judgement: Judgement | None = None) -> str:
    """Keyword include with section, materials, curves and parts of every suspension and tire, units kg, m, s, N.

    Linear suspensions are ``*MAT_SPRING_ELASTIC`` and ``*MAT_DAMPER_VISCOUS``, others
    ``*MAT_SPRING_NONLINEAR_ELASTIC`` and ``*MAT_DAMPER_NONLINEAR_VISCOUS`` with ``*DEFINE_CURVE``, extension positive;
    friction is part of the damper's curve.  Tires are linear.  Identifiers of axle i: 9000 + 10 i + 1 spring, + 2
    damper, + 3 tire spring, + 4 tire damper, each for part, material and curve; 9000 the section.  A comment says
    whether the values may be used, if there is a `judgement`.

    References
    ----------
    LS-DYNA Keyword User's Manual, volume I (``*DEFINE_CURVE``, ``*PART``, ``*SECTION_DISCRETE``) and volume II,
    materials S01, S02, S04 and S05.
    """
    lines = [
        "*KEYWORD",
        *_comment(f"Calibrated suspensions and tires, load case {vehicle.load_case}, {vehicle.source}."),
        *([] if judgement is None else _comment(judgement.remark)),
        *_comment("Units: kg, m, s, N.  Values are of the axle, both sides together: halve them for one side."),
        *_comment("Lengths count from rest under the static load, and forces leave the static load out."),
        "*SECTION_DISCRETE",
        _card(_FIRST, 0, 0.0, 0.0, 0.0, 0.0),
        _card(0.0, 0.0),
    ]
    for remark in vehicle.remarks():
        lines += _comment(remark)
    for s in vehicle.suspensions:
        lines += _suspension(s)
    for i, rates in enumerate(zip(vehicle.tire_stiffness_N_per_m, vehicle.tire_damping_N_s_per_m, strict=True)):
        lines += _comment(f"axle {i + 1}: all tires, tangents at the static load; they must not pull")
        lines += _linear(i, 3, "tire", *rates)
    return "\n".join([*lines, "*END", ""])


def _suspension(s: CalibratedSuspension) -> list[str]:
    lines = _comment(f"axle {s.axle + 1}, {s.name}: law {s.law}, static load on the spring {s.static_load_N:.1f} N")
    if s.linear:
        offset = -s.static_load_N / s.stiffness_N_per_m
        lines += _comment(f"OFFSET of *ELEMENT_DISCRETE that gives the static load: {offset:.6e} m")
        return lines + _linear(s.axle, 1, "suspension", s.stiffness_N_per_m, s.damping_N_s_per_m)
    spring, damper = _identifiers(s.axle, 1)
    lines += ["*MAT_SPRING_NONLINEAR_ELASTIC", _card(spring, spring)]
    lines += _curve(spring, s.extension_m, s.spring_force_N)
    lines += ["*MAT_DAMPER_NONLINEAR_VISCOUS", _card(damper, damper)]
    lines += _curve(damper, *s.damper_with_friction())
    return lines + _parts(s.axle, 1, "suspension")


def _linear(axle: int, first: int, what: str, stiffness: float, damping: float) -> list[str]:
    spring, damper = _identifiers(axle, first)
    lines = ["*MAT_SPRING_ELASTIC", _card(spring, float(stiffness))]
    lines += ["*MAT_DAMPER_VISCOUS", _card(damper, float(damping))]
    return lines + _parts(axle, first, what)


def _identifiers(axle: int, first: int) -> tuple[int, int]:
    return _FIRST + 10 * (axle + 1) + first, _FIRST + 10 * (axle + 1) + first + 1


def _parts(axle: int, first: int, what: str) -> list[str]:
    lines: list[str] = []
    for identifier, element in zip(_identifiers(axle, first), ("spring", "damper"), strict=True):
        lines += ["*PART", f"axle {axle + 1} {what} {element}", _card(identifier, _FIRST, identifier)]
    return lines


def _curve(identifier: int, abscissa: np.ndarray, ordinate: np.ndarray) -> list[str]:
    points = [f"{x:20.12E}{y:20.12E}" for x, y in zip(abscissa, ordinate, strict=True)]
    return ["*DEFINE_CURVE", _card(identifier, 0, 1.0, 1.0, 0.0, 0.0, 0, _RESAMPLED), *points]


def _card(*fields: float) -> str:
    return "".join(_field(value) for value in fields)


def _field(value: float) -> str:
    """A number in ten columns with all the digits that they hold, one blank in front."""
    if isinstance(value, int):
        return f"{value:10d}"
    for digits in range(9, 2, -1):
        text = f"{value:.{digits}G}"
        text = text if "." in text or "E" in text else text + ".0"
        if len(text) <= 9:
            return f"{text:>10}"
    return f"{value:10.2E}"


def _comment(text: str) -> list[str]:
    # A keyword file has 80 columns of plain text; a line end in a name would start a card.
    plain = "".join(c if c.isascii() else "?" for c in plain_line(text))
    return ["$ " + line for line in textwrap.wrap(plain, 76)]
