"""What limits predicted axle loads: passes beyond the driven runs, and travel that is not declared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.numbers import listing, speed
from sysid.results.contents import Results

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction
    from sysid.prediction.trust import Quantity

#: Words for what goes beyond the driven runs, and factor and unit for people.
TRUST_WORDS: dict[Quantity, tuple[str, float, str]] = {
    "speed": ("speed", 3.6, "km/h"),
    "tire_deflection": ("tire deflection", 1e3, "mm"),
    "travel": ("suspension travel", 1e3, "mm"),
    "damper_speed": ("damper speed", 1.0, "m/s"),
    "lift_off": ("time off the road", 1e3, "ms"),
}


def pass_name(p: PassPrediction) -> str:
    """Load case, speed and, where it is none of the scanned ones or one of several, bump of a pass."""
    return f"{p.load_case}, {speed(p.speed_m_s)}\u00a0km/h" + (f" over {p.shape}" if p.shape else "")


def undeclared_travel(results: Results) -> list[int]:
    """Axles (indices) whose travel nobody declared, so that predicted passes assume bump stops there."""
    from sysid.prediction.assumed_stops import axles_without_stops

    vehicle = results.campaign.vehicle
    return [] if results.fit is None else list(axles_without_stops(vehicle, results.fit.parameters))


def half_declared_travel(results: Results) -> list[int]:
    """Axles (indices) of which only one travel is declared: no bump stop acts in the other direction."""
    axles = results.campaign.vehicle.axles
    return [i for i, a in enumerate(axles) if a.has_stops and None in (a.jounce_travel_m, a.rebound_travel_m)]


def cautions(results: Results) -> list[str]:
    """Why axle loads may not be those of the truck."""
    sentences = []
    passes = () if results.predictions is None else results.predictions.passes
    if beyond := [f"{pass_name(p)}: {_beyond(p)}" for p in passes if p.trust]:
        sentences.append(
            f"Predicted passes go beyond what the driven runs reached ({'; '.join(beyond)}). There the axle loads "
            "are an extrapolation of the fitted laws."
        )
    # Where the runs reached as far, a pass may still cross another bump, meet an assumed stop or end before rest.
    return sentences + [w for p in passes if not p.trust for w in p.warnings]


def _beyond(p: PassPrediction) -> str:
    """What of a pass goes beyond the driven runs, and on which axles."""
    parts = []
    for what, (words, _, _) in TRUST_WORDS.items():
        axles = [f"axle {e.axle + 1}" for e in p.trust if e.what == what]
        if axles and what == "speed":
            parts.append(words)
        elif axles:
            where = "every axle" if len(axles) == len(p.static_load_N) else listing(axles)
            parts.append(f"{'lift-off' if what == 'lift_off' else words} of {where}")
    return listing(parts)


def remedies(results: Results, beyond: Sequence[str]) -> list[str]:
    """What would let the predictions say more: runs that reach as far as passes `beyond` them, and declared travel."""
    if results.predictions is None:
        return []
    steps = []
    if beyond:
        passes = [name.replace(", ", " at ", 1) for name in beyond]
        steps.append(
            f"If axle loads matter {listing(passes, 3)}, drive as near to these speeds as is safe, add the "
            "runs and calibrate again: these loads are only computed."
        )
    if unknown := undeclared_travel(results):
        steps.append(
            f"Declare jounce_travel_m and rebound_travel_m of {_listed(results, unknown)}: bump stops then act there, "
            "not at usual travels that the model assumes."
        )
    if half := half_declared_travel(results):
        steps.append(
            f"Declare both jounce_travel_m and rebound_travel_m of {_listed(results, half)}: in the direction without "
            "a travel no bump stop acts."
        )
    return steps


def _listed(results: Results, axles: list[int]) -> str:
    every_axle = len(axles) == len(results.campaign.vehicle.axles)
    return "every axle" if every_axle else listing([f"axle {i + 1}" for i in axles])
