"""Factors by which declared numbers are usually wrong: other units, one side or tire of several, a slipped decimal."""

from __future__ import annotations

import math
from types import MappingProxyType

#: What a value is declared as, over what it should be, by what its key ends in; each with what was then given.
_OF_UNIT = MappingProxyType(
    {
        "kg": (
            (1e-3, "in t"), (2.20462, "in lb"), (9.80665, "in N"), (9.80665e-3, "in kN"), (0.5, "of one side"),
            (2.0, "of two"),
        ),
        "N_per_m": (
            (1e-3, "in N/mm or kN/m"), (1.0 / 9.80665, "in kgf/m"), (1.0 / 9806.65, "in kgf/mm"),
            (1.0 / 175.127, "in lbf/in"), (1.0 / 14.5939, "in lbf/ft"), (0.5, "of one side"),
            (0.25, "of one tire of four"), (2.0, "of two axles"),
        ),
        "N_s_per_m": (
            (1e-3, "in kN s/m"), (1.0 / 175.127, "in lbf s/in"), (0.5, "of one side"), (0.25, "of one tire of four"),
        ),
        "kg_m2": ((1e-3, "in t m2"), (23.7304, "in lb ft2"), (0.73756, "in slug ft2")),
        "m": (
            (1e3, "in mm"), (100.0, "in cm"), (39.3701, "in inches"), (3.28084, "in feet"), (0.5, "half"),
            (2.0, "twice"),
        ),
        "radius_m": ((1e3, "in mm"), (100.0, "in cm"), (39.3701, "in inches"), (2.0, "as a diameter"), (0.5, "half")),
        "km_h": ((1.0 / 3.6, "in m/s"), (1.0 / 1.609344, "in mph")),
        "kPa": ((1e-2, "in bar"), (0.1450377, "in psi"), (1e3, "in Pa"), (1e-3, "in MPa"), (0.980665e-2, "in kgf/cm2")),
        "hz": ((2.0 * math.pi, "in rad/s"), (60.0, "in 1/min"), (1e-3, "in kHz")),
        "s": ((1e3, "in ms"),),
        "m_s": ((1e3, "in mm/s"), (3.6, "in km/h")),
        "N": ((1e-3, "in kN"), (1.0 / 9.80665, "in kgf"), (1.0 / 4.44822, "in lbf"), (0.5, "of one side")),
    }
)  # fmt: skip
_ANY = (2.0, 2.2, 2.20462, 3.28084, 3.6, 9.80665, 10.0, 12.0, 25.4, 39.3701, 100.0, 101.972, 1000.0)
#: All factors, those of units that do not fit among them: numbers are also copied from the wrong cell.
KNOWN = (*_ANY, *(1.0 / f for f in _ANY))
#: Factors are the same where they differ by less than this share.
_NEAR = 0.02


def likely_unit(key: str, low: float, high: float | None = None) -> str:
    """What a value may have been given as that is this factor, or one between two, times the right one; or empty."""
    high = low if high is None else high
    unit = max((u for u in _OF_UNIT if key.lower().endswith(f"_{u}".lower())), key=len, default="")
    fits = [w for f, w in _OF_UNIT.get(unit, ()) if low * (1.0 - _NEAR) <= f <= high * (1.0 + _NEAR)]
    return " or ".join(fits[:2])
