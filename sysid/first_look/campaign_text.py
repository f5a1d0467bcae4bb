"""A campaign file from a first look: commented tables, with TODO where only a person knows the value."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from sysid.campaign.records import AUXILIARY_KINDS
from sysid.campaign.toml.text import banner, commented, quoted, section, todo, toml_key, value_text
from sysid.campaign.toml.todo import CONFIRM
from sysid.first_look.entries import AXLE_BY_NAME, SPEED_BY_NAME
from sysid.first_look.records import EntryGuess, FirstLook, SeenLog, SensorGuess
from sysid.first_look.vehicle_text import axle_name, body_names, load_case_text, vehicle_text
from sysid.wording import shorten

#: Columns of no use, and of text, that are named.
_UNUSED = 200
_TEXT = 40
_HEAD = """\
# Begun by 'init' from the files of {folder}.
#
# What to do: give every value that says "TODO" (in place of the text in quotes), and look at every line that says
# "TODO confirm": there a guess is not supported by both the name and the behaviour of a column.  Then
#     {command}
# lists what is left.  Numbers marked "assumed" are typical ones: put your own where you know them.
# SI units unless a key or a sensor says otherwise; x_m is the distance behind axle 1: see docs/campaign-format.md
schema = 1
"""


def campaign_text(look: FirstLook, folder: str, command: str, prefix: str = "") -> str:
    """The text of a campaign file.

    Parameters
    ----------
    look
        What was found.
    folder, command
        Name of the folder, and the command that checks the file, for comments.
    prefix
        Path from the campaign file to the folder, empty or with a slash at its end.
    """
    parts = [
        _HEAD.format(folder=folder, command=command),
        section("campaign", [f"title = {quoted(f'Campaign in {folder}')}"]),
        vehicle_text(look),
        *(load_case_text(look, name, case) for name, case in look.load_cases.items()),
        _acquisition(look),
        _loggers(look),
        _sensors(look, "bump_run", look.run_sensors),
        _sensors(look, "plank_drop", look.drop_sensors),
        _scans(look, prefix),
        _tests(look, prefix),
    ]
    return "\n".join(part for part in parts if part)


# ---------------------------------------------------------------------- logger and sensors


def _used_logs(look: FirstLook) -> dict[str, SeenLog]:
    files = {entry.file for entry in look.tests}
    return {log.file: log for log in look.logs if log.file in files}


def _acquisition(look: FirstLook) -> str:
    lines = [_interval(sorted({log.rate_hz for log in _used_logs(look).values()}))]
    lines += [(f"{k} = {value_text(v)}", "") for k, v in _writing_of_all(look).items()]
    what = "{ type = 'butterworth', order = 4, cutoff_hz = 60 } of the anti-alias filter, or delete this line"
    lines.append((f"filter = {quoted(todo(what))}", ""))
    return banner("data acquisition") + "\n" + section("acquisition", commented(lines))


def _interval(rates_hz: Sequence[float]) -> tuple[str, str]:
    """The line of the sample interval: that of all logs, to be confirmed where they differ."""
    known = [rate for rate in rates_hz if rate > 0.0]
    if not known:
        return f"sample_interval_s = {quoted(todo('time between two readings of the logger [s]'))}", ""
    step = 1.0 / known[len(known) // 2]
    if known[-1] > 1.02 * known[0] or len(known) < len(rates_hz):
        return f"sample_interval_s = {step:.6g}", f"{CONFIRM}: the logs have {known[0]:.4g} to {known[-1]:.4g} Hz"
    return f"sample_interval_s = {step:.6g}", "as in the logs"


def _loggers(look: FirstLook) -> str:
    """Tables of several loggers; the names of their logs, stamps and rates told them."""
    parts = []
    for k, logger in enumerate(look.loggers):
        said = "the first one: its clock is the reference" if k == 0 else "by the names of the logs"
        lines = [(f"name = {quoted(logger.name)}", f"{CONFIRM}: {said}")]
        if k > 0:
            kind = "continuous" if logger.runs_on else "per_log"
            why = "its stamps run on from log to log" if logger.runs_on else "every log begins at the same stamp"
            lines.append((f"clock = {quoted(kind)}", f'{CONFIRM}: {why}; "shared" with GPS or PTP'))
        if logger.rate_hz > 0.0:
            lines.append((f"sample_interval_s = {1.0 / logger.rate_hz:.6g}", "as in the logs"))
        more = ['# sync = "COLUMN"  where the loggers record one signal, in all tables of loggers'] if k > 0 else []
        parts.append(section("logger", [*commented(lines), *more], array=True))
    return "\n".join(parts)


def _writing_of_all(look: FirstLook) -> dict[str, Any]:
    """How all logs are written, where that has to be said."""
    logs = list(_used_logs(look).values())
    result: dict[str, Any] = {}
    if len({log.time for log in logs}) == 1 and logs[0].time is not None:
        result["time"] = logs[0].time
    return result


def _sensors(look: FirstLook, kind: str, sensors: Sequence[SensorGuess]) -> str:
    if not sensors:
        return ""
    said = "# Column = what it measures.  Add range = full scale (+-) where it is known; sign = -1 turns a sensor.\n"
    idle = [s for s in sensors if s.unused is not None]
    shown = [s for s in sensors if s.unused is None] + idle[:_UNUSED]
    lines = [
        (
            f"{toml_key(s.column)} = {value_text(_sensor(look, s, kind))}",
            _reason_of(s, kind == "plank_drop" and s in look.run_sensors),
        )
        for s in shown
    ]
    # A comment may hold no control characters, which names of columns may.
    more = [f"# {len(idle) - _UNUSED} more columns of no use"] if len(idle) > _UNUSED else []
    text = look.text_columns[:_TEXT] if kind == "bump_run" else ()
    more += [shorten(f"# text, no numbers: {column}", 118) for column in text]
    return said + section(f"sensors.{kind}", [*commented(lines), *more])


def _reason_of(sensor: SensorGuess, said_above: bool) -> str:
    """Why a sensor is what it is; what is to be confirmed of a column of runs and drops stands at the runs."""
    if sensor.sure and sensor.unused is not None:
        return ""
    if said_above:
        return "as in the runs"
    return "; ".join(sensor.why) if sensor.sure and sensor.kind in AUXILIARY_KINDS else _reason(sensor.sure, sensor.why)


def _reason(sure: bool, why: Sequence[str]) -> str:
    return "by name and behaviour" if sure else f"{CONFIRM}: {'; '.join(dict.fromkeys(why))}"


def _sensor(look: FirstLook, sensor: SensorGuess, test: str) -> dict[str, Any]:
    result: dict[str, Any] = {}
    if test == "bump_run" and sensor.column in look.columns:
        logger, column = look.columns[sensor.column]
        result = {"logger": logger} | ({"column": column} if column != sensor.column else {})
    if sensor.unused is not None:
        return result | {"unused": sensor.unused}
    kinds = "suspension_deflection, axle_acceleration, body_acceleration or another kind; if none: unused = 'why'"
    result["kind"] = sensor.kind or todo(kinds)
    result |= _place(look, sensor, test)
    result["unit"] = sensor.unit or todo("unit of its readings")
    if sensor.sign < 0:
        result["sign"] = -1
    if sensor.side is not None:
        result["side"] = sensor.side
    return result


def _place(look: FirstLook, sensor: SensorGuess, test: str) -> dict[str, Any]:
    """Keys for the axle of a sensor, or for the body of a pitch rate."""
    if sensor.kind == "speed":
        return {}
    if sensor.kind == "pitch_rate":
        bodies = body_names(look)
        return {"body": bodies[0] if len(bodies) == 1 else todo(f"name of its body: {' or '.join(bodies)}")}
    if sensor.axle is not None:
        return {"axle": axle_name(look, sensor.axle)}
    return {} if test == "plank_drop" else {"axle": todo("name of its axle")}


# ---------------------------------------------------------------------- scans and tests


def _scans(look: FirstLook, prefix: str) -> str:
    parts = []
    for scan in look.scans:
        name = re.sub(r"\.[^.]*$", "", scan.file.rsplit("/", 1)[-1])
        title = "scan" if len(look.scans) == 1 else f"scan.{toml_key(name)}"
        if scan.levelled:
            size = f"{scan.points} heights, {scan.extent[0]:.3g} m long, {1e3 * scan.extent[1]:.0f} mm high"
            parts.append(section(title, commented([(f"profile = {quoted(prefix + scan.file)}", size)])))
            continue
        hint = ""
        if scan.heading_deg is not None:
            hint = f"; square to the crest it is {scan.heading_deg:.1f} or {scan.heading_deg + 180.0:.1f}"
        heading = todo(f"direction of travel [deg] in the scanner's x-y plane, counter-clockwise from +x{hint}")
        size = f"{scan.points} points, {scan.extent[0]:.3g} x {scan.extent[1]:.3g}"
        lines = [
            (f"file = {quoted(prefix + scan.file)}", size),
            (f"heading_deg = {quoted(heading)}", ""),
            (f"unit = {quoted(scan.unit)}", f"{CONFIRM}: by its size"),
        ]
        parts.append(section(title, commented(lines)))
    if not parts and any(e.kind == "bump_run" for e in look.tests):
        cloud = todo("point cloud of the bump, a file in the folder of this file")
        heading = todo("direction of travel [deg] counter-clockwise from +x of the scanner")
        without = "# without a scanner, in place of both: profile = a CSV file with the columns station_m and height_m"
        parts.append(section("scan", [f"file = {quoted(cloud)}", f"heading_deg = {quoted(heading)}", without]))
    return banner("laser scan of the bump") + "\n" + "\n".join(parts) if parts else ""


def _tests(look: FirstLook, prefix: str) -> str:
    drops = [e for e in look.tests if e.kind == "plank_drop"]
    runs, drives = ([e for e in look.tests if e.kind == kind] for kind in ("bump_run", "road_drive"))
    parts = [banner("tests"), "[tests]"]
    if any(entry.load_case is None for entry in look.tests):
        case = todo(
            f"load case of all drops and runs that do not say their own: {', '.join(look.load_cases)} or another"
        )
        parts.append(f"load_case = {quoted(case)}")
    if drops:
        height = todo("height of the plank [m], of all drops that do not say their own")
        parts += [f"plank_height_m = {quoted(height)}", "plank_drop = ["]
        lines = [(f"{value_text(_drop(look, e, prefix))},", _reason_of_test(e, {AXLE_BY_NAME})) for e in drops]
        if any(AXLE_BY_NAME in e.why for e in drops):
            parts.append(f"  # {CONFIRM}: axles by the names of the files; nothing in these logs can say the axle")
        parts += [*commented(lines, "  "), "]"]
    if runs:
        counts: dict[tuple[str | None, float | None], int] = {}
        lines = []
        by_name = sum(SPEED_BY_NAME in entry.why for entry in runs)
        said = {SPEED_BY_NAME} if by_name > 1 else set()
        for entry in runs:
            driven = (entry.load_case, entry.speed_km_h)
            counts[driven] = counts.get(driven, 0) + 1
            of_run = value_text(_run(look, entry, prefix, counts[driven]))
            lines.append((f"{of_run},", _reason_of_test(entry, said)))
        parts += ["bump_run = [", *(f"  # {CONFIRM}: {why} of {by_name} runs below" for why in said)]
        parts += [*commented(lines, "  "), "]"]
        fastest = max((e.speed_km_h for e in runs if e.speed_km_h is not None), default=None)
        if fastest is not None:
            wanted = [{"load_case": c, "speed_km_h": round(1.5 * fastest)} for c in look.load_cases]
            parts.append("# Passes that nobody drove, to be predicted: change or delete them as you like.")
            parts.append(f"prediction = {value_text(wanted)}")
    if drives:
        lines = [(f"{value_text(_drive(look, entry, prefix))},", _reason_of_test(entry, set())) for entry in drives]
        parts += ["road_drive = [", *commented(lines, "  "), "]"]
    left_out = [f"# {CONFIRM}: left out, {why}: {file}" for file, why in look.left_out.items()]
    return "\n".join([*parts, *(shorten(line, 118) for line in left_out)]) + "\n"


def _writing(look: FirstLook, file: str) -> dict[str, Any]:
    """How one log is written, where not all are written so."""
    time = _used_logs(look)[file].time
    return {} if time is None or "time" in _writing_of_all(look) else {"time": time}


def _drop(look: FirstLook, entry: EntryGuess, prefix: str) -> dict[str, Any]:
    result: dict[str, Any] = {
        "axle": todo("axle on the plank") if entry.axle is None else axle_name(look, entry.axle),
        "file": prefix + entry.file,
    }
    return result | (_load_case(entry) if len(look.load_cases) > 1 else {}) | _writing(look, entry.file)


def _reason_of_test(entry: EntryGuess, said: set[str]) -> str:
    """What to confirm of a drop or run; of what is said once for all of them only a word where some lines have it."""
    why = [reason for reason in entry.why if reason not in said]
    if entry.sure or not why:
        return "" if entry.sure or AXLE_BY_NAME in entry.why else "; ".join(entry.why)
    return _reason(False, why)


def _load_case(entry: EntryGuess) -> dict[str, str]:
    """The load case of a drop or run; one that nothing says is asked for once, for all of them."""
    return {} if entry.load_case is None else {"load_case": entry.load_case}


def _logs_of(look: FirstLook, file: str, prefix: str) -> str | dict[str, str]:
    """The log of a run, or those of its loggers by name."""
    files = look.files.get(file)
    return prefix + file if files is None else {name: prefix + log for name, log in files.items()}


def _drive(look: FirstLook, entry: EntryGuess, prefix: str) -> dict[str, Any]:
    speed = todo("speed [km/h]") if entry.speed_km_h is None else entry.speed_km_h
    driven = {"file": prefix + entry.file, **_load_case(entry), "nominal_speed_km_h": speed}
    return driven | _writing(look, entry.file)


def _run(look: FirstLook, entry: EntryGuess, prefix: str, repeat: int) -> dict[str, Any]:
    speed = entry.speed_km_h
    named = entry.load_case is not None and speed is not None
    label = f"{entry.load_case} {speed:g} km/h" if named else entry.file
    result: dict[str, Any] = {
        "case": label,
        "files" if entry.file in look.files else "file": _logs_of(look, entry.file, prefix),
        **_load_case(entry),
        "nominal_speed_km_h": todo("speed [km/h]") if speed is None else speed,
        "repeat": repeat,
    }
    if len(look.scans) > 1:
        result["bump"] = todo("name of the scan of its bump")
    return result | _writing(look, entry.file)
