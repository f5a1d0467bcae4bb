"""Chrono::Vehicle: spring, shock and tire objects that are merged into one's own suspension and tire files."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import CampaignError

if TYPE_CHECKING:
    from sysid.estimates.calibrated_elements import CalibratedSuspension, CalibratedVehicle
    from sysid.results.contents import Judgement

_COMMENT = re.compile(r'("(?:[^"\\\n]|\\.)*")|//[^\n]*|/\*.*?\*/', re.DOTALL)
#: Where springs end in the templates of Chrono that have one apart.
_ENDS = ("Chassis", "Axle", "Arm", "Upright", "Link")
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
#: Lengths of a spring beyond which Chrono adds the force of stops of its own.
_STOPS = ("Minimum Length", "Maximum Length")


def chrono_suspension(
    vehicle: CalibratedVehicle, s: CalibratedSuspension, judgement: Judgement | None = None
) -> dict[str, Any]:
    """Objects ``Spring`` and ``Shock`` of one suspension, values of one side, as a JSON merge patch (RFC 7396).

    The keys are those that Chrono's ``ReadTSDAFunctorJSON`` reads.  The deformation counts from static rest, where
    ``Preload`` carries the static load: F = Preload - K(length - free length) with the free length at rest
    (:func:`chrono_merged`).  A key set to null removes what the template says otherwise: another kind of element, and
    its stops where the law has some of its own.  The comment ends with the verdict of a `judgement`.
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
    gone = dict.fromkeys((*_DECIDING, *(_STOPS if "bump_stops" in s.law else ())))
    about = f"axle {s.axle + 1} {s.name}, load case {vehicle.load_case}, {vehicle.source}, law {s.law}; one side, SI"
    about += "".join(f". {remark}" for remark in vehicle.remarks(s.axle))
    return {"Comment": _judged(about, judgement), "Spring": gone | spring, "Shock": gone | shock}


def _judged(about: str, judgement: Judgement | None) -> str:
    return about if judgement is None else f"{about.rstrip('.')}. {judgement.remark}"


def chrono_tire(vehicle: CalibratedVehicle, axle: int, judgement: Judgement | None = None) -> dict[str, Any]:
    """Vertical stiffness and damping of the tires of one side as a JSON merge patch for a ``FialaTire`` file.

    Tangents at the static load; dual tires share them.  A curve of the template, which Chrono takes before the
    stiffness, is removed.  The comment ends with the verdict of a `judgement`.
    """
    about = f"axle {axle + 1}, load case {vehicle.load_case}, {vehicle.source}; all tires of one side, SI"
    vertical = {
        "Vertical Stiffness": float(vehicle.tire_stiffness_N_per_m[axle]) / 2.0,
        "Vertical Damping": float(vehicle.tire_damping_N_s_per_m[axle]) / 2.0,
        "Vertical Curve Data": None,
    }
    return {"Comment": _judged(about, judgement), "Fiala Parameters": vertical}


def chrono_text(document: Mapping[str, Any]) -> str:
    """The text of a patch."""
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def chrono_merged(template: Mapping[str, Any], patch: Mapping[str, Any]) -> dict[str, Any]:
    """A Chrono suspension or tire file with the calibrated values in it.

    The merge follows RFC 7396.  ``Free Length`` of a spring becomes the distance of its two ends, that is its length
    at static rest if the file's locations are those at rest.

    Parameters
    ----------
    template : one's own file, as :func:`read_chrono` gives it.
    patch : one of the files that ``export`` wrote.

    Raises
    ------
    CampaignError
        If the template has no spring with two locations where the patch has a spring, or one whose stops press at rest.
    """
    merged: dict[str, Any] = _merged(template, patch)
    if "Spring" in patch:
        spring = merged["Spring"]
        ends = [spring.get(f"Location {end}") for end in _ENDS]
        given = [e for e in ends if isinstance(e, list) and len(e) == 3]
        if len(given) != 2:
            raise CampaignError(
                "The Chrono template has no 'Spring' with 'Location Chassis' and 'Location Axle' (or Arm, Upright, "
                "Link); give a suspension file with a separate spring, such as SolidAxle or LeafspringAxle."
            )
        spring["Free Length"] = math.dist(*given)
        _check_stops(spring)
    return merged


def _check_stops(spring: Mapping[str, Any]) -> None:
    least, most = (spring.get(key) for key in _STOPS)
    rest = spring["Free Length"]
    if least is not None and most is not None and not least <= rest <= most:
        raise CampaignError(
            f"The Chrono template's spring is {rest:g} m long between its two locations, but 'Minimum Length' is "
            f"{least:g} and 'Maximum Length' {most:g}: its stops would press at rest. Correct or remove the two keys."
        )


def read_chrono(path: Path) -> dict[str, Any]:
    """A Chrono file, which may have comments (``//`` and ``/* */``).

    Raises
    ------
    CampaignError
        If the file cannot be read or holds no JSON object.
    """
    try:
        # Strings stay as they are: a comment's sign in one is no comment.
        text = _COMMENT.sub(lambda m: m[1] or " ", Path(path).read_text(encoding="utf-8-sig"))
        tables = json.loads(text)
    except OSError as error:
        raise CampaignError(f"The Chrono file {Path(path).name} cannot be read ({error.strerror}).") from None
    except ValueError as error:
        raise CampaignError(f"The Chrono file {Path(path).name} is no JSON ({error}).") from None
    if not isinstance(tables, dict):
        raise CampaignError(f"The Chrono file {Path(path).name} holds no JSON object; name a suspension or tire file.")
    return tables


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
