"""Campaign files that differ from a right one by what is ordinary: tolerances, data books, notes, what is left out."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

#: Two standard deviations of what is declared, as logarithms: unsprung masses, inertias, heights as the default
#: tolerances; tires, travels and dampers as data books; speeds as speedometers.
SPREAD = {
    "unsprung_mass_kg": 0.06,
    "pitch_inertia_kg_m2": 0.15,
    "cg_height_m": 0.1,
    "hitch_height_m": 0.06,
    "tire_stiffness_N_per_m": 0.2,
    "tire_damping_N_s_per_m": 0.7,
    "tire_radius_m": 0.06,
    "jounce_travel_m": 0.2,
    "rebound_travel_m": 0.2,
    "nominal_speed_km_h": 0.03,
    "plank_height_m": 0.03,
}
#: Readings of scales, two standard deviations.
SCALE = 0.01


def varied(parsed: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A file that is as right as the one given, for the same logs."""
    result = copy.deepcopy(parsed)
    vehicle, cases = result["vehicle"], result["load_case"]
    plank = float(rng.uniform(-1.0, 1.0))
    for table in (*vehicle["axle"], *vehicle["body"], *result["tests"].get("bump_run", ())):
        for key in SPREAD.keys() & table.keys():
            table[key] = float(table[key]) * float(np.exp(SPREAD[key] * rng.uniform(-1.0, 1.0)))
    for drop in result["tests"].get("plank_drop", ()):
        if "plank_height_m" in drop:
            drop["plank_height_m"] = float(drop["plank_height_m"]) * float(np.exp(SPREAD["plank_height_m"] * plank))
    tied: dict[tuple[str, int, float], float] = {}
    for case in cases.values():
        for key in ("pitch_inertia_kg_m2", "cg_height_m"):
            # A body of the same mass is the same body.
            factors = [
                tied.setdefault((key, b, mass), float(np.exp(SPREAD[key] * rng.uniform(-1.0, 1.0))))
                for b, mass in enumerate(case["sprung_mass_kg"])
            ]
            case[key] = [float(v) * f for v, f in zip(case[key], factors, strict=True)]
        _balanced(case, vehicle, rng)
    for axle in vehicle["axle"]:
        if rng.random() < 0.3:
            axle.pop("jounce_travel_m", None)
            axle.pop("rebound_travel_m", None)
        if rng.random() < 0.15:
            axle["tire_damping_N_s_per_m"] = 0.0
    for name, likely in (("wheelbase_m", 0.5), ("gravity_m_s2", 0.0)):
        if rng.random() < likely:
            vehicle.pop(name, None)
    if rng.random() < 0.3:
        vehicle["gravity_m_s2"] = 9.80665
    if rng.random() < 0.3:
        vehicle["tolerances"] = {"unsprung_mass": 0.05, "pitch_inertia": 0.2, "axle_load": 0.01}
    if rng.random() < 0.3:
        result["acquisition"].pop("filter", None)
    return result


def _balanced(case: dict[str, Any], vehicle: dict[str, Any], rng: np.random.Generator) -> None:
    """Readings of a scale with their errors, and sprung masses that are the rest, body by body."""
    before = [float(v) for v in case["axle_loads_kg"]]
    loads = [v * float(np.exp(SCALE * rng.uniform(-1.0, 1.0))) for v in before]
    case["axle_loads_kg"] = [round(v, -1) for v in loads]
    unsprung = sum(float(a["unsprung_mass_kg"]) for a in vehicle["axle"])
    sprung = [float(v) for v in case["sprung_mass_kg"]]
    rest = sum(case["axle_loads_kg"]) - unsprung
    heaviest = int(np.argmax(sprung))
    sprung[heaviest] += rest - sum(sprung)
    case["sprung_mass_kg"] = [round(v, 1) for v in sprung]
