"""What Chrono::Vehicle takes from a suspension or tire file, written from reading its sources.

Project Chrono, commit 7689fbc: `ReadTSDAFunctorJSON` in src/chrono/input_output/ChUtilsJSON.cpp (which kind of element,
which keys it asks for), the force functors in src/chrono/utils/ChForceFunctors.cpp, ChFunctionInterp.cpp (no point
twice, flat beyond the ends), and `Create` of the templates in src/chrono_vehicle/wheeled_vehicle.  A key that the C++
asks for without looking is a KeyError or TypeError here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

_PART = {"Mass": float, "COM": list, "Inertia": list, "Radius": float}
_SPINDLE = {**_PART, "Width": float}
_ARM = {
    "Mass": float, "COM": list, "Moments of Inertia": list, "Products of Inertia": list, "Radius": float,
    "Location Chassis Front": list, "Location Chassis Back": list, "Location Upright": list,
}  # fmt: skip
_ROD = {"Mass": float, "Inertia": list, "Radius": float}
_LINK = {
    **_PART, "Location Chassis": list, "Location Upright": list, "Universal Joint Axis Link": list,
    "Universal Joint Axis Chassis": list,
}  # fmt: skip
_AXLE = {"Inertia": float}


def _ends(other: str) -> dict[str, type]:
    return {"Location Chassis": list, f"Location {other}": list}


#: Objects and keys that each template's `Create` reads unasked.
REQUIRED: dict[str, dict[str, dict[str, type]]] = {
    "SolidAxle": {
        "Spindle": _SPINDLE, "Knuckle": {**_PART, "Location Lower": list, "Location Upper": list},
        "Upper Link": {**_PART, **_ends("Axle")}, "Lower Link": {**_PART, **_ends("Axle")}, "Axle Tube": _PART,
        "Trackbar": {**_ROD, **_ends("Axle")}, "Tierod": {**_ROD, "Location Knuckle": list},
        "Draglink": {**_ROD, "Location Chassis": list, "Location Bell Crank": list},
        "Bell Crank": {**_ROD, "Location Tierod": list, "Location Axle": list},
        "Spring": _ends("Axle"), "Shock": _ends("Axle"), "Axle": _AXLE,
    },
    "SolidThreeLinkAxle": {
        "Spindle": _SPINDLE, "Axle Tube": _PART, "Triangular Link": {"Mass": float, "Inertia": list, **_ends("Axle")},
        "Longitudinal Link": {"Mass": float, "Inertia": list, **_ends("Axle")},
        "Spring": _ends("Axle"), "Shock": _ends("Axle"), "Axle": _AXLE,
    },
    "LeafspringAxle": {
        "Spindle": _SPINDLE, "Axle Tube": _PART, "Spring": _ends("Axle"), "Shock": _ends("Axle"), "Axle": _AXLE,
    },
    "DoubleWishbone": {
        "Spindle": _SPINDLE,
        "Upright": {k: v for k, v in _ARM.items() if not k.startswith("Location")},
        "Upper Control Arm": _ARM, "Lower Control Arm": _ARM, "Tierod": _ends("Upright"), "Spring": _ends("Arm"),
        "Shock": _ends("Arm"), "Axle": _AXLE,
    },
    "MacPhersonStrut": {
        "Spindle": _SPINDLE, "Upright": _PART,
        "Control Arm": {**_PART, **{k: list for k in _ARM if k.startswith("Location")}}, "Strut": _ROD,
        "Tierod": _ends("Upright"), "Spring": _ends("Upright"), "Shock": _ends("Upright"), "Axle": _AXLE,
    },
    "MultiLink": {
        "Spindle": _SPINDLE, "Upright": _PART,
        "Upper Arm": {**_PART, **{k: list for k in _ARM if k.startswith("Location")}}, "Lateral": _LINK,
        "Trailing Link": _LINK, "Tierod": _ends("Upright"), "Spring": _ends("Link"), "Shock": _ends("Link"),
        "Axle": _AXLE,
    },
}  # fmt: skip

_FIALA = (
    "Unloaded Radius", "Width", "Vertical Stiffness", "Vertical Damping", "Rolling Resistance", "CSLIP", "CALPHA",
    "UMIN", "UMAX",
)  # fmt: skip


def number(value: Any) -> float:
    """A JSON number as Chrono's GetDouble takes it."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def vector(value: Any) -> np.ndarray:
    """Three numbers."""
    if not isinstance(value, list) or len(value) != 3:
        raise TypeError(f"{value!r} is no vector")
    return np.array([number(v) for v in value])


def _table(value: Any) -> np.ndarray:
    if not isinstance(value, list) or len(value[0]) != 2:
        raise TypeError("a curve needs pairs")
    points = np.array([[number(x), number(y)] for x, y in value])
    if len(set(points[:, 0])) < len(points):
        raise ValueError("a point stands twice")
    return points[np.argsort(points[:, 0])]


@dataclass(frozen=True)
class Element:
    """A translational spring-damper: its `kind`, free length [m], and what makes up its force."""

    kind: str
    free_length: float = 0.0
    preload: float = 0.0
    spring: float | np.ndarray = 0.0
    damper: float | np.ndarray = 0.0
    degressivity: tuple[float, float] = (0.0, 0.0)
    stops: tuple[float, float] | None = field(default=None)

    def force(self, length: float, rate: float) -> float:
        """Force that drives the ends apart [N], stops left out."""
        if self.stops is not None and not self.stops[0] <= length <= self.stops[1]:
            raise ValueError("a stop presses")
        slope = self.degressivity[1] * rate if rate >= 0.0 else -self.degressivity[0] * rate
        extension = length - self.free_length
        return self.preload - _along(self.spring, extension) - _along(self.damper, rate) / (1.0 + slope)


def _along(law: float | np.ndarray, x: float) -> float:
    return float(np.interp(x, *law.T)) if isinstance(law, np.ndarray) else law * x


def element(tsda: Any) -> Element:
    """The element that Chrono makes of an object `Spring` or `Shock`."""
    if not isinstance(tsda, dict):
        raise TypeError("no object")
    kind = "unknown"
    if "Spring Coefficient" in tsda:
        kind = "linear spring-damper" if "Damping Coefficient" in tsda else "linear spring"
    elif "Damping Coefficient" in tsda:
        degressive = "Degressivity Compression" in tsda and "Degressivity Expansion" in tsda
        kind = "degressive damper" if degressive else "linear damper"
    if "Spring Curve Data" in tsda:
        kind = "spring-damper curve" if "Damping Curve Data" in tsda else "spring curve"
    elif "Damping Curve Data" in tsda:
        kind = "damper curve"
    if "Map Data" in tsda:
        return Element("map")
    if kind == "unknown":
        raise KeyError("Unsupported TSDA element")
    parts: dict[str, Any] = {}
    if "spring" in kind:
        parts["free_length"] = number(tsda["Free Length"])
        parts["preload"] = number(tsda.get("Preload", 0.0))
        curved = "curve" in kind
        parts["spring"] = _table(tsda["Spring Curve Data"]) if curved else number(tsda["Spring Coefficient"])
        if "Minimum Length" in tsda and "Maximum Length" in tsda:
            parts["stops"] = (number(tsda["Minimum Length"]), number(tsda["Maximum Length"]))
    if "damper" in kind:
        curved = "curve" in kind
        parts["damper"] = _table(tsda["Damping Curve Data"]) if curved else number(tsda["Damping Coefficient"])
    if kind == "degressive damper":
        parts["degressivity"] = (number(tsda["Degressivity Compression"]), number(tsda["Degressivity Expansion"]))
    return Element(kind, **parts)


def suspension(document: dict[str, Any]) -> tuple[Element, Element, float]:
    """Spring and shock of a whole suspension file, and the length of the spring between its locations [m]."""
    assert document["Type"] == "Suspension"
    assert isinstance(document["Name"], str)
    for part, keys in REQUIRED[document["Template"]].items():
        for key, kind in keys.items():
            (vector if kind is list else number)(document[part][key])
    ends = [vector(v) for k, v in document["Spring"].items() if k.startswith("Location")]
    length = float(np.linalg.norm(ends[0] - ends[1]))
    return element(document["Spring"]), element(document["Shock"]), length


def fiala_vertical(document: dict[str, Any], depth: float, closing: float) -> float:
    """Vertical force [N] of a whole FialaTire file at a penetration [m] that grows at `closing` [m/s]."""
    assert (document["Type"], document["Template"]) == ("Tire", "FialaTire")
    assert isinstance(document["Name"], str)
    number(document["Mass"])
    vector(document["Inertia"])
    values = {key: number(document["Fiala Parameters"][key]) for key in _FIALA}
    curve = document["Fiala Parameters"].get("Vertical Curve Data")
    elastic = values["Vertical Stiffness"] * depth if curve is None else float(np.interp(depth, *_table(curve).T))
    return max(elastic + values["Vertical Damping"] * closing, 0.0)
