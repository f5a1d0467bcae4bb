"""Campaign folders whose runs were recorded by two loggers, each with a clock of its own.

Both loggers write all columns; which of them are read, the campaign file says.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import numpy as np
from campaign_files import sensor_columns, write_log
from synthetic_campaign import RINGING_S, Physics, Simulator, bump_profile, measured, write_campaign

FIRST, SECOND = "tractor box", "trailer box"
#: Runs begin so far apart on a clock that runs on.
PAUSE_S = 120.0


@dataclass(frozen=True)
class SecondClock:
    """The second clock shows (t_ref - `offset_s`) / (1 + `rate`)."""

    offset_s: float = 0.2
    rate: float = 1e-4

    def shown(self, time_s: np.ndarray) -> np.ndarray:
        """Its stamps at times of the reference."""
        return np.asarray((time_s - self.offset_s) / (1.0 + self.rate))


def duplicate_logs(source: Path, folder: Path, clock: SecondClock) -> None:
    """A campaign folder with a second log of every run: the same readings, with the stamps of the second clock."""
    (folder / "bump_runs").mkdir(parents=True)
    for name in ("campaign.toml", "bump_scan.csv"):
        shutil.copy(source / name, folder / name)
    for k, file in enumerate(sorted((source / "bump_runs").glob("*.csv"))):
        head, *rows = file.read_text(encoding="utf-8").splitlines()
        time = np.array([float(row.split(",", 1)[0]) for row in rows]) + PAUSE_S * k
        _restamp(folder / "bump_runs" / file.name, head, rows, time)
        _restamp(folder / "bump_runs" / f"second_{file.name}", head, rows, clock.shown(time))


def simulate_logs(folder: Path, physics: Physics, clock: SecondClock) -> None:
    """A synthetic campaign, the second logger sampling the same runs at moments of its own clock.

    It is started `late_s` after the first one, between two samples of that.
    """
    whole = folder.with_name(f"{folder.name} as one")
    truth = write_campaign(whole, physics)
    duplicate_logs(whole, folder, clock)
    made = tomllib.loads((whole / "truth.toml").read_text(encoding="utf-8"))["bump_run"]
    seconds = [
        physics.start_s[1] + (truth.vehicle.axles[-1].x_m + physics.bump_length_m) / run["speed_m_s"] + RINGING_S
        for run in made
    ]
    step = physics.sample_interval_s
    slow = replace(physics, sample_interval_s=step * (1.0 + clock.rate))
    simulator = Simulator(truth, slow, bump_profile(physics), int(max(seconds) / step))
    rng = np.random.default_rng(physics.seed + 1000)
    columns, kinds = sensor_columns(len(truth.vehicle.axles))
    order = sorted(Path(run["file"]).name for run in made)
    for run, length in zip(made, seconds, strict=True):
        name = Path(run["file"]).name
        k = order.index(name)
        clean = simulator.readings(name.split("_")[0], run["speed_m_s"], run["start_s"] - late_s(k))
        file = folder / "bump_runs" / f"second_{name}"
        write_log(file, step, columns, kinds, measured(clean, kinds, physics, rng)[: int((length - 0.3) / step)])
        head, *rows = file.read_text(encoding="utf-8").splitlines()
        begin = float(clock.shown(np.array(late_s(k) + PAUSE_S * k)))
        _restamp(file, head, rows, begin + step * np.arange(len(rows)))


def late_s(k: int) -> float:
    """How long after the first logger the second one is started in run k, by name."""
    return 0.1 + 0.0017 * (k + 1)


def _restamp(file: Path, head: str, rows: list[str], time: np.ndarray) -> None:
    lines = [f"{t:.6f},{row.split(',', 1)[1]}" for t, row in zip(time, rows, strict=True)]
    file.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def loggers_declared(
    text: str,
    second: Callable[[str], bool],
    logger: str,
    runs: Callable[[str], bool] = lambda name: True,
    sensors: Callable[[str], bool] = lambda name: True,
) -> str:
    """A campaign file with two loggers: `second` says which columns are those of the second one.

    `logger` are lines for the table of the second logger; only some runs and sensors of runs stay, and no drops.
    """
    lines, table = [], ""
    for line in text.splitlines():
        table = line.split("#")[0].strip() if line.startswith("[") else table
        if table == "[sensors.bump_run]" and "kind" in line:
            column = line.split("=")[0].strip()
            if not sensors(column):
                continue
            if second(column):
                line = line.replace("{ kind", f'{{ logger = "{SECOND}", kind')
        elif line.startswith("[sensors.bump_run]"):
            lines += ["[[logger]]", f'name = "{FIRST}"', "", "[[logger]]", f'name = "{SECOND}"', logger, ""]
        elif "plank_drops/" in line:
            continue
        elif "bump_runs/" in line:
            head, rest = line.split('file = "bump_runs/', 1)
            file, rest = rest.split('"', 1)
            if not runs(file):
                continue
            both = f'"{FIRST}" = "bump_runs/{file}", "{SECOND}" = "bump_runs/second_{file}"'
            line = f"{head}files = {{ {both} }}{rest}"
        lines.append(line)
    return "\n".join(lines) + "\n"
