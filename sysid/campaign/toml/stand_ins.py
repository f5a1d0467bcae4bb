"""An unfinished campaign file made readable: stand-ins for values that the check of its logs does not need."""

from __future__ import annotations

import copy
from typing import Any

from sysid.campaign.toml.todo import MARK, find_todos, is_todo

#: Numbers that the check of the logs does not use, but the reader needs.
_UNUSED: dict[str, Any] = {
    "title": "unfinished",
    "name": "unnamed",
    "case": "unnamed",
    "unsprung_mass_kg": 500.0,
    "tire_stiffness_N_per_m": 1e6,
    "tire_damping_N_s_per_m": 3000.0,
    "tire_radius_m": 0.5,
    "suspension": "other",
    "plank_height_m": 0.08,
    "heading_deg": 0.0,
    "sample_interval_s": 0.005,
}
_PER_AXLE = ("axle_loads_kg",)
_PER_BODY = ("sprung_mass_kg", "pitch_inertia_kg_m2", "cg_height_m")
#: An axle at an unknown place stands just behind the one before: the check then judges no speed by it.
_STEP_M = 0.01


def with_stand_ins(tables: dict[str, Any], label: str) -> tuple[dict[str, Any], frozenset[str]]:
    """Tables without any value that is still to be filled in, and the load cases whose masses are not known.

    Sensors, drops, runs and predictions are left out if a value that their check needs is missing. Optional keys are
    left out too. Other values get a stand-in.

    Parameters
    ----------
    tables : as parsed; they are not changed.
    label : name of the campaign file.
    """
    result: dict[str, Any] = copy.deepcopy(tables)
    paths = [todo.path for todo in find_todos(tables)]
    unknown = {str(p[1]) for p in paths if p[0] == "load_case" and len(p) > 2}
    if any(p[:2] == ("vehicle", "axle") for p in paths):
        unknown |= set(tables.get("load_case", {}))
    _complete_vehicle(result)
    _complete_load_cases(result)
    _complete_scans(result, label)
    if _has_todo(_table(result, "acquisition").get("filter")):
        del result["acquisition"]["filter"]
    for kind in ("bump_run", "plank_drop"):
        of_kind = _table(_table(result, "sensors"), kind)
        for column in [c for c, sensor in of_kind.items() if _has_todo(sensor)]:
            del of_kind[column]
    tests = _table(result, "tests")
    if any(isinstance(s, dict) and s.get("kind") == "speed" for s in _table(result["sensors"], "bump_run").values()):
        # The speed is logged.
        for run in _entries(tests, "bump_run"):
            if is_todo(run.get("nominal_speed_km_h")):
                del run["nominal_speed_km_h"]
    if is_todo(tests.get("load_case")):
        for run in _entries(tests, "bump_run"):
            run.setdefault("load_case", MARK)
    for kind, wanted in (("plank_drop", ("axle", "axles", "file")), ("bump_run", ("file", "files", "load_case"))):
        needed = (*wanted, "nominal_speed_km_h") if kind == "bump_run" else wanted
        if isinstance(tests.get(kind), list):
            tests[kind] = [e for e in tests[kind] if not any(_has_todo(_of(e, key)) for key in needed)]
    if isinstance(tests.get("prediction"), list):
        tests["prediction"] = [e for e in tests["prediction"] if not _has_todo(e)]
    return _without_todos(result), frozenset(unknown)


def _table(tables: dict[str, Any], key: str) -> dict[str, Any]:
    """A table in another, an empty one where there is none."""
    found = tables.get(key)
    return found if isinstance(found, dict) else {}


def _of(entry: Any, key: str) -> Any:
    return entry.get(key) if isinstance(entry, dict) else None


def _has_todo(value: Any) -> bool:
    if isinstance(value, dict):
        return any(map(_has_todo, value.values()))
    return any(map(_has_todo, value)) if isinstance(value, list) else is_todo(value)


def _entries(tables: dict[str, Any], key: str) -> list[dict[str, Any]]:
    found = tables.get(key)
    return [e for e in found if isinstance(e, dict)] if isinstance(found, list) else []


def _complete_vehicle(tables: dict[str, Any]) -> None:
    vehicle = _table(tables, "vehicle")
    bodies = _entries(vehicle, "body")
    for i, body in enumerate(bodies):
        if is_todo(body.get("name")):
            body["name"] = f"body {i + 1}"
        if is_todo(body.get("hitch_x_m")):
            # A hinge at an unknown place: the check of the logs needs none.
            del body["hitch_x_m"]
            body.pop("hitch_height_m", None)
    before = 0.0
    for i, axle in enumerate(_entries(vehicle, "axle")):
        if is_todo(axle.get("name")):
            axle["name"] = f"axle {i + 1}"
        if is_todo(axle.get("body")) and bodies:
            axle["body"] = bodies[0].get("name")
        if is_todo(axle.get("x_m")):
            axle["x_m"] = 0 if i == 0 else before + _STEP_M
        before = axle["x_m"] if isinstance(axle.get("x_m"), int | float) else before
    if _has_todo(vehicle.get("group")):
        del vehicle["group"]


def _complete_load_cases(tables: dict[str, Any]) -> None:
    vehicle = _table(tables, "vehicle")
    counts = {**dict.fromkeys(_PER_AXLE, len(_entries(vehicle, "axle")))}
    counts |= dict.fromkeys(_PER_BODY, len(_entries(vehicle, "body")))
    for case in _table(tables, "load_case").values():
        if isinstance(case, dict):
            if _has_todo(case.get("axle_loads_kg")):
                case.setdefault("sprung_mass_kg", MARK)
            for key, count in counts.items():
                if _has_todo(case.get(key)):
                    case[key] = [1.0 if key == "cg_height_m" else 1000.0] * count


def _complete_scans(tables: dict[str, Any], label: str) -> None:
    scan = tables.get("scan")
    if not isinstance(scan, dict):
        return
    several = all(isinstance(v, dict) for v in scan.values())
    for one in scan.values() if several else [scan]:
        if is_todo(one.get("file")):
            # The check reads no points; a file has to be there.
            one["file"] = label
    names = list(scan) if several else ["bump"]
    for run in _entries(_table(tables, "tests"), "bump_run"):
        if is_todo(run.get("bump")):
            run["bump"] = names[0]


def _without_todos(value: Any) -> Any:
    """Stand-ins for values that are not used; optional ones are left out."""
    if isinstance(value, dict):
        kept = {k: _UNUSED.get(k) if is_todo(v) else _without_todos(v) for k, v in value.items()}
        return {k: v for k, v in kept.items() if v is not None}
    return [_without_todos(v) for v in value if not is_todo(v)] if isinstance(value, list) else value
