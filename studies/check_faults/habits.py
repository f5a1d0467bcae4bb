"""Healthy campaigns in other people's habits: `check` must accuse nothing and reject nothing.

    python -m studies.check_faults.habits [--per-campaign N] [--seed SEED] [--document FILE] [CAMPAIGN ...]

The logs of each campaign are written again with other names (four languages), units, rates, orders of columns, stamps,
encodings and decimal marks; with sensors on both sides that differ as by roll, modules that start late, and frame
sensors on a clock of their own or in every second row.
"""

from __future__ import annotations

import argparse
import copy
import re
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import resample_poly

from studies.check_faults.campaigns import base
from studies.check_faults.case import HARMLESS
from studies.check_faults.numbers import Bench
from studies.documents import write_between_marks
from sysid.campaign.toml.reading import parse_toml

BASES = ("data", "linear_truck", "rigid3", "rigid4", "semitrailer5")
#: Names of sensors by kind, with the words for left and right.
LANGUAGES: dict[str, dict[str, str]] = {
    "English": {
        "suspension_deflection": "Susp. travel {n}{s}", "axle_acceleration": "Axle {n} vert. accel.{s}",
        "body_acceleration": "Chassis accel. {n}{s}", "left": " LH", "right": " RH", "time": "Time",
    },
    "German": {
        "suspension_deflection": "Federweg Achse {n}{s}", "axle_acceleration": "Beschl. Achse {n} Z{s}",
        "body_acceleration": "Rahmenbeschl. {n}{s}", "left": " links", "right": " rechts", "time": "Zeit",
    },
    "French": {
        "suspension_deflection": "Débattement essieu {n}{s}", "axle_acceleration": "Accél. essieu {n}{s}",
        "body_acceleration": "Accél. châssis {n}{s}", "left": " gauche", "right": " droite", "time": "Temps",
    },
    "Spanish": {
        "suspension_deflection": "Carrera susp. eje {n}{s}", "axle_acceleration": "Acel. eje {n}{s}",
        "body_acceleration": "Acel. bastidor {n}{s}", "left": " izq", "right": " der", "time": "Tiempo",
    },
}  # fmt: skip
#: Units and how many of each are one of the campaign's (mm and g).
UNITS = {
    "suspension_deflection": {"mm": 1.0, "cm": 0.1, "m": 1e-3, "in": 1.0 / 25.4},
    "axle_acceleration": {"g": 1.0, "m/s^2": 9.80665, "cm/s^2": 980.665},
    "body_acceleration": {"g": 1.0, "m/s^2": 9.80665, "mm/s^2": 9806.65},
}
STAMPS = ("seconds", "milliseconds", "time of day", "too few digits", "from 2718.5 s on")


@dataclass(frozen=True)
class Habit:
    """What one campaign is written in."""

    language: str
    units: dict[str, str]
    up: int
    sides: tuple[str, ...]
    late_s: float
    frames: str
    stamps: str
    separator: str
    decimal: str
    encoding: str

    @property
    def said(self) -> str:
        """In words."""
        units = ", ".join(dict.fromkeys(self.units.values()))
        sides = f"both sides of {' and '.join(self.sides)}" if self.sides else "one side"
        return f"{self.language}; {units}; rate times {self.up}; {sides}; {self.stamps}; frames {self.frames}"


def drawn(rng: np.random.Generator) -> Habit:
    """A habit drawn at random."""

    def one(values: Any) -> Any:
        values = list(values)
        return values[int(rng.integers(len(values)))]

    separator, decimal = one(((",", "."), (";", ","), ("\t", "."), (";", ".")))
    frames = one(("on the common clock", "on their own clock", "in every second row"))
    return Habit(
        language=one(LANGUAGES),
        units={kind: one(units) for kind, units in UNITS.items()},
        # Behind the filters of these campaigns half their rate would be too slow.
        up=one((1, 1, 2)) if frames == "on the common clock" else 2,
        sides=one(
            ((), ("axle_acceleration",), ("suspension_deflection",), ("axle_acceleration", "suspension_deflection"))
        ),
        late_s=one((0.0, 0.5)),
        frames=frames,
        stamps=one(STAMPS),
        separator=separator,
        decimal=decimal,
        encoding=one(("utf-8", "utf-8-sig", "utf-16")),
    )


class Writer:
    """Writes a campaign in a habit: its logs into a folder, its campaign file as tables."""

    def __init__(self, source: Path, target: Path, habit: Habit, rng: np.random.Generator) -> None:
        self.source, self.target, self.rng = source, target, rng
        self.tables = parse_toml((source / "campaign.toml").read_bytes(), "campaign.toml")
        tests = self.tables["tests"]
        logs = [pd.read_csv(source / e["file"]) for e in (*tests["bump_run"], *tests["plank_drop"])]
        # What lost rows or readings cannot be given another rate.
        whole = all(np.ptp(np.diff(log["time_s"])) < 1e-6 and not log.isna().any().any() for log in logs)
        self.habit = habit if whole else replace(habit, up=1, frames="on the common clock")
        self.words = LANGUAGES[habit.language]

    def write(self) -> dict[str, Any]:
        """The tables of the campaign file; logs and scans lie in the folder."""
        shutil.rmtree(self.target, ignore_errors=True)
        shutil.copytree(self.source, self.target, ignore=shutil.ignore_patterns("true", "road_drives"))
        result = copy.deepcopy(self.tables)
        for test in ("bump_run", "plank_drop"):
            sensors = self.tables["sensors"][test]
            names = {column: self._names(column, number, s) for number, (column, s) in enumerate(sensors.items())}
            result["sensors"][test] = {
                name: self._sensor(sensors[column], side) for column in sensors for name, side in names[column]
            }
            for entry in self.tables["tests"][test]:
                self._log(entry["file"], sensors, names, test == "bump_run")
        result["acquisition"]["sample_interval_s"] /= self.habit.up
        return result

    @property
    def _time_name(self) -> str:
        unit = " [ms]" if self.habit.stamps == "milliseconds" else "" if self.habit.stamps == "time of day" else " [s]"
        return self.words["time"] + unit

    def _names(self, column: str, number: int, sensor: dict[str, Any]) -> list[tuple[str, str | None]]:
        kind = sensor["kind"]
        digits = re.findall(r"\d+", column)
        label = digits[0] if digits else str(number + 1)
        sides: tuple[str | None, ...] = (
            ("left", "right") if kind in self.habit.sides and "side" not in sensor else (None,)
        )
        side_word = {None: ""} | {s: self.words[s] for s in ("left", "right")}
        return [
            (f"{self.words[kind].format(n=label, s=side_word[side])} [{self.habit.units[kind]}]", side)
            for side in sides
        ]

    def _sensor(self, sensor: dict[str, Any], side: str | None) -> dict[str, Any]:
        unit = self.habit.units[sensor["kind"]]
        changed = {**sensor, "unit": unit} | ({} if side is None else {"side": side})
        if "range" in sensor:
            changed["range"] = sensor["range"] * UNITS[sensor["kind"]][unit]
        return changed

    def _log(
        self, file: str, sensors: dict[str, Any], names: dict[str, list[tuple[str, str | None]]], run: bool
    ) -> None:
        habit, log = self.habit, pd.read_csv(self.source / file)
        step = float(np.median(np.diff(log["time_s"]))) / habit.up
        up = habit.up
        count = up * len(log)
        time = log["time_s"].to_numpy() if up == 1 else log["time_s"].iloc[0] + step * np.arange(count)
        data: dict[str, np.ndarray] = {}
        frames = []
        for column in [*sensors][:: 1 if self.rng.random() < 0.5 else -1]:
            value = log[column].to_numpy(float)
            level = value[0]
            value = value if up == 1 else resample_poly(value - level, up, 1, padtype="edge") + level
            kind = sensors[column]["kind"]
            if "range" in sensors[column]:
                value = np.clip(value, -sensors[column]["range"], sensors[column]["range"])
            # Roll: half of the difference is an eighth of the motion, half a slow motion of its own.
            roll = 0.05 * np.nanstd(value) * np.sin(2.0 * np.pi * 0.9 * time + self.rng.uniform(0.0, 6.0))
            for name, side in names[column]:
                sign = {None: 0.0, "left": 1.0, "right": -1.0}[side]
                moved = value + sign * (0.08 * (value - level) + roll) if side else value
                if "range" in sensors[column]:
                    moved = np.clip(moved, -sensors[column]["range"], sensors[column]["range"])
                data[name] = moved * UNITS[kind][habit.units[kind]]
                if kind == "body_acceleration":
                    frames.append(name)
        if run and habit.late_s and frames:
            for name in frames[:2]:
                data[name] = np.where(time - time[0] < habit.late_s, np.nan, data[name])
        table = pd.DataFrame({self._time_name: self._stamps(time, step), **data})
        if frames and habit.frames == "in every second row":
            table.loc[table.index % 2 == 1, frames] = np.nan
        if frames and habit.frames == "on their own clock" and habit.stamps in ("seconds", "from 2718.5 s on"):
            own = table[frames].iloc[::2].reset_index(drop=True)
            own.insert(0, f"{self.words['time']} 2 [s]", table[self._time_name].iloc[::2].reset_index(drop=True))
            table = pd.concat([table.drop(columns=frames), own], axis=1)
        text = table.to_csv(
            index=False, sep=habit.separator, decimal=habit.decimal, float_format="%.7g", lineterminator="\n"
        )
        (self.target / file).write_bytes(text.encode(habit.encoding))

    def _stamps(self, time: np.ndarray, step: float) -> Any:
        if self.habit.stamps == "milliseconds":
            return np.round(1e3 * time, 3)
        if self.habit.stamps == "time of day":
            return [
                f"10:{5 + int(t // 60):02d}:{t % 60:06.3f}".replace(".", self.habit.decimal) for t in time - time[0]
            ]
        if self.habit.stamps == "too few digits":
            return np.floor((time - time[0]) / (2.0 * step) + 1e-6) * 2.0 * step
        return np.round(time + (2718.5 if self.habit.stamps.startswith("from") else 0.0), 5)


def examined(source: Path, target: Path, number: int, seed: int) -> dict[str, Any]:
    """What `check` says of a campaign in a habit that names a fault, and was not said of the campaign itself."""
    rng = np.random.default_rng([seed, number])
    habit = drawn(rng)
    writer = Writer(source, target, habit, rng)
    tables = writer.write()
    end, said = Bench(target).check(tables)
    accusing = sorted(s for s in said if not re.search(f"{HARMLESS}|{_OF_HABITS}", s))
    return {"campaign": source.name, "habit": writer.habit.said, "end": end, "accusing": accusing}


#: Sentences that describe how a log is written, or what the campaigns themselves have: lost rows and clipped peaks.
_OF_HABITS = (
    r"only '.*' is used; the other side shows|different rates|evenly spread|too few digits|repeat the one before|"
    r"is read so|rows are missing|is lost from|far below its range|samples? (is|are) clipped|"
    r"height of the bump differs|does not change from|readings? (is|are) missing"
)


def main(arguments: list[str] | None = None) -> None:
    """Write and check every campaign in several habits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", nargs="*", type=Path, help="folders; by default five trucks of the studies")
    parser.add_argument("--output", type=Path, default=Path("build/check_faults"))
    parser.add_argument("--per-campaign", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    parser.add_argument("--document", type=Path, default=None)
    options = parser.parse_args(arguments)
    folders = options.campaigns or [base(name, options.output / "bases", 7301) for name in BASES]
    records = []
    for place, folder in enumerate(folders):
        for number in range(options.per_campaign):
            target = options.output / "habits" / f"{folder.name}_{number}"
            records.append(examined(folder, target, 1000 * place + number, options.seed))
            shutil.rmtree(target)
            last = records[-1]
            sys.stdout.write(f"{last['campaign']} {number} {last['end']}: {last['habit']}: {last['accusing']}\n")
            sys.stdout.flush()
    accused = [r for r in records if r["accusing"] or r["end"] != "passed"]
    body = (
        f"{len(records)} campaigns in other habits, seed {options.seed}: {len(accused)} with a sentence that names a "
        "fault, or with a rejected record."
    )
    body += "".join(f"\n- {r['campaign']} ({r['habit']}): {' '.join(r['accusing'])[:300]}" for r in accused)
    sys.stdout.write(f"{body}\n")
    if options.document is not None:
        write_between_marks(options.document, "campaigns in other habits", body)


if __name__ == "__main__":
    main()
