"""The logs of a campaign written again: in other formats, with the names of other people, or with none."""

from __future__ import annotations

import random
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

#: Words in which other people name the same columns, by kind; {} is the number of the axle.
GERMAN = {
    "suspension_deflection": "Federweg Achse {} [mm]",
    "axle_acceleration": "Beschl. Achse {} [g]",
    "body_acceleration": "Rahmenbeschl. über Achse {} [g]",
}
FRENCH = {
    "suspension_deflection": "débattement_essieu{}_mm",
    "axle_acceleration": "accel_essieu{}_g",
    "body_acceleration": "accel_châssis{}_g",
}
SHORT = {"suspension_deflection": "D{}", "axle_acceleration": "AX{}_Z", "body_acceleration": "FR{}_Z"}


@dataclass(frozen=True)
class Variant:
    """One way to write a campaign: `format` of its logs, `names` of its columns, whether files keep their names.

    Columns of the kind `without` are left out, with ``others`` all but axle accelerations.
    """

    title: str
    format: str = "csv"
    names: str = "as they are"
    anonymous_files: bool = False
    without: str = ""


VARIANTS = (
    Variant("as it is"),
    Variant("MDF 4", "mf4"),
    Variant("TDMS", "tdms"),
    Variant("MAT", "mat"),
    Variant("German names", names="german"),
    Variant("French names, from 0", names="french"),
    Variant("short names without units", names="short"),
    Variant("columns ch01, ch02, ..., shuffled", names="anonymous"),
    Variant("columns and files anonymous", names="anonymous", anonymous_files=True),
    Variant("two columns exchanged by name", names="exchanged"),
    Variant("accelerations in m/s^2 under names with g", names="wrong unit"),
    Variant("one axle sensor upside down", names="upside down"),
    Variant("all sensors of one axle upside down", names="all upside down"),
    Variant("no frame sensors", without="body_acceleration"),
    Variant("no deflections", without="suspension_deflection"),
    Variant("no frame sensors, anonymous columns", names="anonymous", without="body_acceleration"),
    Variant("only axles, anonymous columns and files", names="anonymous", anonymous_files=True, without="others"),
)


@dataclass(frozen=True)
class Written:
    """A folder with the logs of a campaign, and what is true of it.

    `tables` are those of its campaign file; `column` maps new names to old ones per kind of test; `file` maps new file
    names to old ones; `changed` are new names of columns of which something is wrong on purpose, with the kind, unit,
    sign and number of the axle (1 is the first) that they have in truth.
    """

    folder: Path
    tables: Mapping[str, Any]
    column: Mapping[str, Mapping[str, str]]
    file: Mapping[str, str]
    changed: Mapping[str, Mapping[str, Any]]


def write_variant(campaign: Path, folder: Path, variant: Variant) -> Written:
    """Write the logs and the scans of a campaign into a new folder."""
    tables = tomllib.loads((campaign / "campaign.toml").read_text(encoding="utf-8"))
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for scan in [tables["scan"]] if "file" in tables["scan"] else tables["scan"].values():
        (folder / scan["file"]).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(campaign / scan["file"], folder / scan["file"])
    columns: dict[str, dict[str, str]] = {}
    files: dict[str, str] = {}
    changed: dict[str, dict[str, Any]] = {}
    shuffled = random.Random(5)
    for kind in ("bump_run", "plank_drop"):
        sensors = {c: s for c, s in tables["sensors"].get(kind, {}).items() if _there(s["kind"], variant.without)}
        renamed = _renamed(sensors, tables, variant.names, shuffled)
        columns[kind] = {new: old for old, new in renamed.items()}
        for entry in tables["tests"].get(kind, []):
            old = Path(entry["file"])
            name = f"rec_{len(files) + 1:03d}" if variant.anonymous_files else str(old.with_suffix(""))
            table = pd.read_csv(campaign / old)[["time_s", *sensors]]
            changed |= _spoiled(table, sensors, tables, variant.names, kind, renamed)
            order = list(sensors)
            if variant.names == "anonymous":
                random.Random(7).shuffle(order)
            table = table[["time_s", *order]].rename(columns=renamed)
            path = folder / f"{name}.{variant.format}"
            path.parent.mkdir(parents=True, exist_ok=True)
            _WRITERS[variant.format](path, table)
            files[path.relative_to(folder).as_posix()] = entry["file"]
    return Written(folder, tables, columns, files, changed)


def _there(kind: str, without: str) -> bool:
    return kind != without and (without != "others" or kind == "axle_acceleration")


def _axle_number(sensor: Mapping[str, Any], tables: Mapping[str, Any]) -> str:
    axles = sorted(tables["vehicle"]["axle"], key=lambda a: a["x_m"])
    if "axle" in sensor:
        return str([a["name"] for a in axles].index(sensor["axle"]) + 1)
    if "x_m" in sensor:
        return str(int(np.argmin([abs(a["x_m"] - sensor["x_m"]) for a in axles])) + 1)
    return ""


def _renamed(
    sensors: Mapping[str, Any], tables: Mapping[str, Any], names: str, shuffled: random.Random
) -> dict[str, str]:
    if names == "anonymous":
        numbers = list(range(1, len(sensors) + 1))
        shuffled.shuffle(numbers)
        return {old: f"ch{n:02d}" for old, n in zip(sensors, numbers, strict=True)}
    words = {"german": GERMAN, "french": FRENCH, "short": SHORT}.get(names)
    if words is None:
        return {old: old for old in sensors}
    result = {}
    for old, sensor in sensors.items():
        number = _axle_number(sensor, tables)
        if names == "french" and number:
            number = str(int(number) - 1)
        result[old] = words[sensor["kind"]].format(number)
    return result


def _spoiled(
    table: pd.DataFrame,
    sensors: Mapping[str, Any],
    tables: Mapping[str, Any],
    names: str,
    kind: str,
    new: Mapping[str, str],
) -> dict[str, dict[str, Any]]:
    """Something wrong on purpose; the new names of the columns that it touches, and what they are in truth."""

    def place(column: str) -> dict[str, Any]:
        number = _axle_number(sensors[column], tables)
        return {"kind": sensors[column]["kind"], "axle": int(number) if number else None}

    axles = [c for c, s in sensors.items() if s["kind"] == "axle_acceleration"]
    if names == "exchanged" and kind == "bump_run":
        frame = next(c for c, s in sensors.items() if s["kind"] == "body_acceleration")
        changed: dict[str, dict[str, Any]] = {}
        for one, two in ((axles[0], frame), (axles[-1], axles[-2])):
            table[[one, two]] = table[[two, one]].to_numpy()
            changed |= {new[one]: place(two), new[two]: place(one)}
        return changed
    if names == "wrong unit":
        wrong = [c for c, s in sensors.items() if s["kind"] != "suspension_deflection"]
        table[wrong] *= 9.80665
        return {new[c]: {"unit": "m/s^2"} for c in wrong}
    if names == "upside down" and kind == "bump_run":
        table[axles[1]] *= -1.0
        return {new[axles[1]]: {"sign": -1}}
    if names == "all upside down" and kind == "bump_run":
        number = _axle_number(sensors[axles[1]], tables)
        turned = [c for c, s in sensors.items() if _axle_number(s, tables) == number]
        table[turned] *= -1.0
        return {new[c]: {"sign": -1} for c in turned}
    return {}


def _csv(path: Path, table: pd.DataFrame) -> None:
    table.to_csv(path, index=False)


def _mdf(path: Path, table: pd.DataFrame) -> None:
    from asammdf import MDF, Signal

    time = table["time_s"].to_numpy()
    with MDF(version="4.10") as file:
        file.append([Signal(table[c].to_numpy(), time, name=c, unit=_unit(str(c))) for c in table.columns[1:]])
        file.save(path, overwrite=True)


def _tdms(path: Path, table: pd.DataFrame) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment(
            [ChannelObject("log", c, table[c].to_numpy(), {"unit_string": _unit(str(c))}) for c in table]
        )


def _mat(path: Path, table: pd.DataFrame) -> None:
    from scipy.io import savemat

    savemat(path, {c: table[c].to_numpy() for c in table}, do_compression=True)


def _unit(column: str) -> str:
    return next((u for u in ("mm", "g", "s") if column.endswith(f"_{u}")), "")


_WRITERS: dict[str, Callable[[Path, pd.DataFrame], None]] = {"csv": _csv, "mf4": _mdf, "tdms": _tdms, "mat": _mat}
