"""Vehicle and load cases of a campaign file from a first look: a template, or tables to fill in."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

from sysid.campaign.toml.text import banner, commented, quoted, section, todo, toml_key, value_text
from sysid.campaign.toml.todo import CONFIRM
from sysid.first_look.load_cases import LoadCaseGuess
from sysid.first_look.records import FirstLook
from sysid.first_look.templates import Template

#: Standard deviations of mass properties that nobody has measured: assumptions.
_TOLERANCES = {"unsprung_mass": 0.1, "pitch_inertia": 0.25, "cg_height": 0.1, "hitch_height": 0.05}


def vehicle_text(look: FirstLook) -> str:
    """The tables of the vehicle."""
    chosen = look.template
    if chosen is None:
        return banner("vehicle") + _unknown_vehicle(look)
    guessed = "" if look.template_given else f"{CONFIRM}: vehicle chosen by the number and arrivals of its axles"
    lines = [
        (f"name = {quoted(str(chosen.vehicle['name']))}", guessed),
        (f"tolerances = {value_text(_TOLERANCES)}", "wide, because masses below are assumed"),
    ]
    source = textwrap.fill(f"Template {chosen.name}: {chosen.source}", 118, initial_indent="# ", subsequent_indent="# ")
    parts = [banner("vehicle"), f"{source}\n", section("vehicle", commented(lines))]
    for body in chosen.vehicle["body"]:
        said = [(f"{k} = {value_text(v)}", "" if k == "name" else "assumed") for k, v in body.items()]
        parts.append(section("vehicle.body", commented(said), array=True))
    for i, axle in enumerate(chosen.axles):
        parts.append(section("vehicle.axle", commented(_axle_lines(look, chosen, i, axle)), array=True))
    return "\n".join(parts)


def _axle_lines(look: FirstLook, chosen: Template, index: int, axle: Mapping[str, Any]) -> list[tuple[str, str]]:
    result = []
    for key, value in axle.items():
        said = "" if key in ("name", "body") else "assumed"
        if key == "x_m" and index == 0:
            said = ""
        elif key == "x_m":
            value, said = _position(look, chosen, index)
        result.append((f"{key} = {value_text(value)}", said))
    return result


def _position(look: FirstLook, chosen: Template, index: int) -> tuple[float, str]:
    """Position of an axle, and what is said of it: all positions that rest on one thing are confirmed together."""
    value, said, own = _position_alone(look, chosen, index)
    if own:
        return value, f"{CONFIRM}: {said}; measure it"
    together = [i for i in range(1, len(chosen.axles)) if not _position_alone(look, chosen, i)[2]]
    if index != together[0]:
        return value, said
    whose = f"axle{'s' * (len(together) > 1)} {', '.join(str(i + 1) for i in together)}"
    return value, f"{CONFIRM}: x_m of {whose}, {said}; measure"


def _position_alone(look: FirstLook, chosen: Template, index: int) -> tuple[float, str, bool]:
    """Position [m], where it comes from, and whether it has to be confirmed by itself: something speaks against it."""
    assumed = chosen.positions_m[index]
    if look.measured_m is None:
        return assumed, "assumed", False
    measured = look.measured_m[index]
    if not look.template_given:
        return round(measured, 2), "by arrivals at the speeds in the names", False
    if abs(measured - assumed) < max(0.15, 0.04 * assumed):
        return assumed, "assumed, arrivals agree", False
    return assumed, f"assumed, arrivals at the speeds in the names say {measured:.2f}", True


def _unknown_vehicle(look: FirstLook) -> str:
    parts = [
        f"# No template has {look.axles} axles.\n"
        if look.axles
        else "# Nothing says how many axles there are: give --vehicle to init.\n",
        section("vehicle", [f"name = {quoted(todo('name of the vehicle'))}"]),
        section("vehicle.body", ['name = "vehicle"'], array=True),
    ]
    for i in range(max(look.axles, 1)):
        measured = look.measured_m[i] if look.measured_m else None
        hint = "" if measured is None else f"; arrivals at the speeds in the names say {measured:.2f}"
        values = {
            "name": axle_name(look, i),
            "body": "vehicle",
            "x_m": 0 if i == 0 else todo(f"distance behind axle 1 [m]{hint}"),
            "unsprung_mass_kg": todo("axle, wheels, hubs and brakes [kg]"),
            "tire_stiffness_N_per_m": todo("all tires of the axle [N/m]"),
            "tire_damping_N_s_per_m": 3000,
            "tire_radius_m": 0.5,
            "suspension": "other",
        }
        lines = [
            (f"{k} = {value_text(v)}", "assumed" if k in ("tire_damping_N_s_per_m", "tire_radius_m") else "")
            for k, v in values.items()
        ]
        parts.append(section("vehicle.axle", commented(lines), array=True))
    return "\n".join(parts)


def axle_name(look: FirstLook, index: int) -> str:
    """Name of an axle in the file."""
    return f"axle {index + 1}" if look.template is None else str(look.template.axles[index]["name"])


def body_names(look: FirstLook) -> list[str]:
    """Names of the bodies, front to rear."""
    return ["vehicle"] if look.template is None else [str(body["name"]) for body in look.template.vehicle["body"]]


def load_case_text(look: FirstLook, name: str, case: LoadCaseGuess) -> str:
    """The table of a load case."""
    chosen, bodies = look.template, body_names(look)
    loads = todo(f"scale readings [kg], a list of {look.axles}, front to rear")
    lines = [(f"axle_loads_kg = {quoted(loads)}", "")]
    if len(bodies) > 1:
        masses = todo(
            f"[{', '.join(bodies)}] [kg]: axle loads less unsprung masses, shared between the bodies as weighed apart"
        )
        lines.append((f"sprung_mass_kg = {quoted(masses)}", ""))
    if chosen is None:
        lines += [
            (f"pitch_inertia_kg_m2 = {quoted(todo('a list of one [kg m2]; m L^2 / 12 for an even load'))}", ""),
            (f"cg_height_m = {quoted(todo('a list of one [m] above ground'))}", ""),
        ]
    else:
        like = "empty" if case.kind in ("empty", None) else "laden"
        said = f"assumed, of the {like} template"
        said = said if case.kind in ("empty", "laden") else f"{CONFIRM}: {said}"
        lines += [
            (f"{key} = {value_text(chosen.load_cases[like][key])}", said)
            for key in ("pitch_inertia_kg_m2", "cg_height_m")
        ]
    doubt = f"# {CONFIRM}: {case.doubt}\n" if case.doubt else ""
    return doubt + section(f"load_case.{toml_key(name)}", commented(lines))
