"""Chrono::Vehicle: spring, shock and tire objects that are merged into one's own suspension and tire files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import CampaignError

if TYPE_CHECKING:
    from sysid.prediction.calibrated_elements import CalibratedSuspension, CalibratedVehicle

#: Keys by which Chrono tells the kinds of spring-dampers apart: those of the template must not stay.
_DECIDING = (
    "Spring Coefficient",
    "Spring Curve Data",
    "Damping Coefficient",
    "Damping Curve Data",
    "Degressivity Compression",
    "Degressivity Expansion",
    "Deformation",
    "Map Data",
    "Preload",
)


def chrono_suspension(vehicle: CalibratedVehicle, s: CalibratedSuspension) -> dict[str, Any]:
    """Objects ``Spring`` and ``Shock`` of one suspension, values of one side, as a JSON merge patch (RFC 7396).

    The keys are those that Chrono's ``ReadTSDAFunctorJSON`` reads.  The deformation counts from static rest, where
    ``Preload`` carries the static load: F = Preload - K(length - free length) with the free length at rest
    (:func:`chrono_merged`).  A key set to null removes what the template says otherwise.
    """
    spring: dict[str, Any] = {"Preload": s.static_load_N / 2.0}
    shock: dict[str, Any]
    if s.linear:
        spring |= {"Spring Coefficient": s.stiffness_N_per_m / 2.0}
        shock = {"Damping Coefficient": s.damping_N_s_per_m / 2.0}
    else:
        rate, force = s.damper_with_friction()
        spring |= {"Spring Curve Data": np.column_stack([s.extension_m, s.spring_force_N / 2.0]).tolist()}
        shock = {"Damping Curve Data": np.column_stack([rate, force / 2.0]).tolist()}
    gone = dict.fromkeys(_DECIDING)
    about = f"axle {s.axle + 1} {s.name}, load case {vehicle.load_case}, {vehicle.source}, law {s.law}; one side, SI"
    return {"Comment": about, "Spring": gone | spring, "Shock": gone | shock}


def chrono_tire(vehicle: CalibratedVehicle, axle: int) -> dict[str, Any]:
    """Vertical stiffness and damping of the tires of one side as a JSON merge patch for a ``FialaTire`` file.

    Tangents at the static load; dual tires share them.
    """
    about = f"axle {axle + 1}, load case {vehicle.load_case}, {vehicle.source}; all tires of one side, SI"
    vertical = {
        "Vertical Stiffness": float(vehicle.tire_stiffness_N_per_m[axle]) / 2.0,
        "Vertical Damping": float(vehicle.tire_damping_N_s_per_m[axle]) / 2.0,
    }
    return {"Comment": about, "Fiala Parameters": vertical}


def chrono_text(document: Mapping[str, Any]) -> str:
    """The text of a patch."""
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def chrono_merged(template: Mapping[str, Any], patch: Mapping[str, Any]) -> dict[str, Any]:
    """A Chrono suspension or tire file with the calibrated values in it.

    The merge follows RFC 7396.  ``Free Length`` of a spring becomes the distance of its two ends, that is its length
    at static rest if the file's locations are those at rest.

    Parameters
    ----------
    template : one's own file, as :func:`json.load` gives it.
    patch : one of the files that ``export`` wrote.

    Raises
    ------
    CampaignError
        If the template has no spring with two locations where the patch has a spring.
    """
    merged = _merged(template, patch)
    if "Spring" in patch:
        spring = merged["Spring"]
        ends = [spring.get(f"Location {end}") for end in ("Chassis", "Axle", "Arm")]
        given = [e for e in ends if isinstance(e, list) and len(e) == 3]
        if len(given) != 2:
            raise CampaignError(
                "The Chrono template has no 'Spring' with 'Location Chassis' and 'Location Axle' (or 'Location Arm'); "
                "give a suspension file with a separate spring, such as SolidAxle or LeafspringAxle."
            )
        spring["Free Length"] = math.dist(*given)
    return merged


def _merged(target: Any, patch: Any) -> Any:
    if not isinstance(patch, Mapping):
        return patch
    result = dict(target) if isinstance(target, Mapping) else {}
    for key, value in patch.items():
        if value is None:
            result.pop(key, None)
        else:
            result[key] = _merged(result.get(key), value)
    return result
