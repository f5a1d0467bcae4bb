"""Air pressures at rest against the loads that the campaign file declares.

A levelled bellows carries F = A p, so the load on the suspension over the gauge pressure is an area, the same in every
load case: L_i / p_i = A_i.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.campaign.records import BumpRun, Campaign, Channel, PlankDrop
from sysid.campaign.statics import carried_by_suspensions, static_equilibrium
from sysid.campaign.vehicle_records import Axle
from sysid.wording import shorten

#: |ln| by which areas of one axle may differ between load cases, and a declared area from them: levelling valves,
#: scales and leaves beside the bellows.
_APART = 0.22
#: |ln| from which a log does not show the pressures of its load case, and within which it shows those of another.
_OTHER, _SAME = 0.2, 0.1
#: Areas of all bellows of an axle that trucks have [m2], with room to spare, and units that may be meant.
_AREAS_M2 = (0.02, 0.5)
_UNITS = {"bar": 1e5, "kPa": 1e3, "MPa": 1e6, "psi": 6894.757293168361, "mbar": 100.0, "Pa": 1.0}
#: Begin of a record that counts as rest, if it is no shorter [s]; absolute pressure where a gauge shows zero [Pa].
_REST_S, _ATMOSPHERE_PA = 0.5, 101_325.0


def pressure_complaints(campaign: Campaign) -> list[str]:
    """Sentences about pressures at rest that contradict axle loads, areas, units, or the load cases of logs."""
    shown: dict[str, dict[tuple[int, str], dict[str, float]]] = {}
    declared: dict[str, tuple[str, float | None]] = {}
    for test in _tests(campaign):
        for channel in test.log.auxiliary:
            sensor = channel.sensor
            if sensor.kind == "air_pressure" and sensor.axle is not None and (rest := _at_rest(channel)) is not None:
                of_logs = shown.setdefault(sensor.column, {}).setdefault((sensor.axle, test.load_case), {})
                of_logs[test.log.file] = rest
                declared[sensor.column] = sensor.unit, sensor.area_m2
    if not shown:
        return []
    together = carried_by_suspensions(campaign.vehicle)
    loads = {
        name: together @ static_equilibrium(campaign.vehicle, case).suspension_preload_N
        for name, case in campaign.load_cases.items()
    }
    said = _misplaced_logs(campaign, shown)
    for column, of_column in shown.items():
        unit, area = declared[column]
        for axle in sorted({a for a, _ in of_column}):
            pressures = {case: float(np.median(list(p.values()))) for (a, case), p in of_column.items() if a == axle}
            carried = {case: float(loads[case][axle]) for case in pressures}
            sentence = _of_axle(column, unit, area, campaign.vehicle.axles[axle], pressures, carried, said)
            if sentence:
                said.append(sentence)
    return said


def _tests(campaign: Campaign) -> tuple[BumpRun | PlankDrop, ...]:
    return (*campaign.bump_runs, *campaign.plank_drops)


def _at_rest(channel: Channel) -> float | None:
    """Median pressure [Pa] at the begin of the record, None where the bellows hold none."""
    good = np.isfinite(channel.value)
    first = good & (channel.time_s <= channel.time_s[0] + _REST_S)
    value = channel.value[first] if first.sum() >= 3 else channel.value[good]
    level = float(np.median(value)) if value.size else 0.0
    return level if level > 0.0 else None


def _of_axle(
    column: str,
    unit: str,
    declared_m2: float | None,
    of: Axle,
    pressures: Mapping[str, float],
    carried: Mapping[str, float],
    said: Sequence[str],
) -> str:
    axle = of.name
    areas = {case: carried[case] / p for case, p in pressures.items()}
    known = list(areas.values())
    low, high = (declared_m2 * np.exp(-1.0), declared_m2 * np.exp(1.0)) if declared_m2 else _AREAS_M2
    if not low <= float(np.median(known)) <= high:
        case = next(iter(areas))
        counts = {u: areas[case] * _UNITS.get(unit, 1e5) / f for u, f in _UNITS.items() if u != unit}
        near = [u for u, a in counts.items() if low <= a <= high and u in ("bar", "kPa", "MPa", "psi")]
        remedy = f"set unit = '{near[0]}'" if len(near) == 1 else "correct its unit or scale"
        return (
            f"'{shorten(column)}' reads {pressures[case] / _UNITS.get(unit, 1e5):.3g} {unit} at rest, with which the "
            f"bellows of axle '{shorten(axle)}' need an area of {areas[case]:.2g} m2 for the declared loads: {remedy} "
            "in campaign.toml."
        )
    # Where logs stand under another load case, the areas say nothing.
    if any("shows the air pressures of" in s for s in said):
        return ""
    if declared_m2 is not None:
        off = {case: float(np.log(a / declared_m2)) for case, a in areas.items()}
        wrong = [case for case, far in off.items() if abs(far) > _APART]
        if not wrong:
            return ""
        case = max(wrong, key=lambda c: abs(off[c]))
        rest = "area_m2, or the axle load or" if len(wrong) == len(off) else "the axle load or"
        return (
            f"'{shorten(column)}' at rest in load case '{shorten(case)}' carries "
            f"{1e-3 * pressures[case] * declared_m2:.3g} kN on area_m2 = {declared_m2:g}, but the axle loads leave "
            f"{1e-3 * carried[case]:.3g} kN for the suspension of axle '{shorten(axle)}'; check {rest} unsprung "
            "mass of that axle, or the load case of the logs."
        )
    # Leaves beside bellows carry their share.
    if len(areas) < 2 or of.suspension != "air":
        return ""
    least, most = min(areas, key=lambda c: areas[c]), max(areas, key=lambda c: areas[c])
    if np.log(areas[most] / areas[least]) <= _APART:
        return ""
    absolute = {case: carried[case] / max(p - _ATMOSPHERE_PA, 1.0) for case, p in pressures.items()}
    if (
        min(pressures.values()) > 1.2 * _ATMOSPHERE_PA
        and np.log(max(absolute.values()) / min(absolute.values())) < 0.07
    ):
        return (
            f"'{shorten(column)}' seems to be an absolute pressure: loads and pressures at rest of axle "
            f"'{shorten(axle)}' agree if the atmosphere is taken off. Give the pressure as a gauge shows it."
        )
    a, b = sorted((least, most), key=lambda c: pressures[c])
    return (
        f"From load case '{shorten(a)}' to '{shorten(b)}', '{shorten(column)}' grows {pressures[b] / pressures[a]:.2f} "
        f"times at rest, but the load on the suspension of axle '{shorten(axle)}' {carried[b] / carried[a]:.2f} times; "
        "check axle_loads_kg and the load cases of the logs."
    )


def _misplaced_logs(
    campaign: Campaign, shown: Mapping[str, Mapping[tuple[int, str], Mapping[str, float]]]
) -> list[str]:
    """Sentences about logs whose pressures are those of another load case."""
    listed = {t.log.file: t.load_case for t in _tests(campaign)}
    said = []
    for file, case in listed.items():
        off: list[float] = []
        others: dict[str, list[float]] = {}
        for of_column in shown.values():
            for (axle, of_case), logs in of_column.items():
                if of_case != case or file not in logs:
                    continue
                own = [p for f, p in logs.items() if f != file]
                if own:
                    off.append(float(np.log(logs[file] / np.median(own))))
                for (a, other), found in of_column.items():
                    if a == axle and other != case:
                        level = float(np.median(list(found.values())))
                        others.setdefault(other, []).append(float(np.log(logs[file] / level)))
        # Two logs of a case that contradict each other do not say which of them is wrong.
        alike = sum(c == case for c in listed.values())
        if alike < 3 or not off or min(map(abs, off)) < _OTHER:
            continue
        near = [name for name, far in others.items() if max(map(abs, far)) < _SAME]
        if near:
            said.append(
                f"{shorten(file, 100)} is listed in load case '{shorten(case)}', but shows the air pressures of "
                f"'{shorten(near[0])}'; correct its load_case."
            )
    return said
