"""Campaign folders whose runs were recorded by two loggers, each with a clock of its own."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import numpy as np
from campaign_files import sensor_columns, write_log
from synthetic_campaign import (
    RINGING_S,
    Physics,
    Simulator,
    bump_profile,
    measured,
    write_campaign,
)
from vehicles import example_vehicle

SECOND = "trailer box"


@dataclass(frozen=True)
class SecondClock:
    """The second clock shows (t_ref - `offset_s`) / (1 + `rate`); runs are `pause_s` apart where it runs on."""

    offset_s: float = 0.2
    rate: float = 1e-4
    clock: str = "continuous"
    pause_s: float = 120.0
    more: str = ""

    def shown(self, time_s: np.ndarray) -> np.ndarray:
        return np.asarray((time_s - self.offset_s) / (1.0 + self.rate))


def split_campaign(source: Path, folder: Path, second: Callable[[str], bool], clock: SecondClock) -> None:
    """A copy of a campaign in which columns of the second logger stand in files of their own, with its stamps.

    The readings are those of the original, at the same moments.
    """
    shutil.copytree(source, folder)
    for k, file in enumerate(sorted((folder / "bump_runs").glob("*.csv"))):
        names = file.read_text(encoding="utf-8").splitlines()[0].split(",")
        rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()[1:]]
        theirs = [i for i, name in enumerate(names) if second(name)]
        ours = [i for i in range(1, len(names)) if i not in theirs]
        time = np.array([float(row[0]) for row in rows]) + clock.pause_s * k * (clock.clock == "continuous")
        _write(file, time, names, rows, ours)
        _write(file.with_name(f"second_{file.name}"), clock.shown(time), names, rows, theirs)
    _write_toml(folder, second, clock)


def _write(file: Path, time: np.ndarray, names: Sequence[str], rows: Sequence[Sequence[str]], kept: list[int]) -> None:
    lines = [",".join(["time_s", *(names[i] for i in kept)])]
    lines += [",".join([f"{t:.6f}", *(row[i] for i in kept)]) for t, row in zip(time, rows, strict=True)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_toml(folder: Path, second: Callable[[str], bool], clock: SecondClock) -> None:
    lines, table = [], ""
    for line in (folder / "campaign.toml").read_text(encoding="utf-8").splitlines():
        table = line if line.startswith("[") else table
        if line.startswith("[sensors.bump_run]"):
            lines += ["[[logger]]", 'name = "tractor box"', "", "[[logger]]", f'name = "{SECOND}"']
            lines += [f'clock = "{clock.clock}"', clock.more, ""]
        column = line.split("=")[0].strip()
        if table.startswith("[sensors.bump_run]") and "kind" in line and second(column):
            line = line.replace("{ kind", f'{{ logger = "{SECOND}", kind')
        if "bump_runs/" in line:
            head, rest = line.split('file = "bump_runs/', 1)
            file, rest = rest.split('"', 1)
            both = f'"tractor box" = "bump_runs/{file}", "{SECOND}" = "bump_runs/second_{file}"'
            line = f"{head}files = {{ {both} }}{rest}"
        lines.append(line)
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_two_loggers(folder: Path, physics: Physics, second: Callable[[str], bool], clock: SecondClock) -> None:
    """A synthetic campaign, the second logger sampling the same runs at moments of its own clock."""
    whole = folder.with_name(f"{folder.name} as one")
    truth = write_campaign(whole, physics)
    split_campaign(whole, folder, second, clock)
    made = _runs(whole)
    example = example_vehicle(physics.vehicle)
    slow = replace(physics, sample_interval_s=physics.sample_interval_s * (1.0 + clock.rate))
    rng = np.random.default_rng(physics.seed + 1000)
    columns, kinds = sensor_columns(len(example.vehicle.axles))
    samples = max(int(_seconds(physics, truth, speed) / physics.sample_interval_s) for _, _, speed, _ in made)
    simulator = Simulator(truth, slow, bump_profile(physics), samples)
    for k, (file, case, speed, start) in enumerate(made):
        # The second logger is started a little later, between two samples of the first one.
        late = 0.1 + 0.0017 * (k + 1)
        count = int((_seconds(physics, truth, speed) - 0.3) / physics.sample_interval_s)
        clean = simulator.readings(case, speed, start - late)[:count]
        values = measured(clean, kinds, physics, rng)
        theirs = [i for i, name in enumerate(columns) if second(name)]
        at = folder / file.replace("bump_runs/", "bump_runs/second_")
        write_log(
            at, physics.sample_interval_s, [columns[i] for i in theirs], [kinds[i] for i in theirs], values[:, theirs]
        )
        order = sorted(Path(f).name for f, *_ in made).index(Path(file).name)
        begin = clock.shown(np.array([late + clock.pause_s * order * (clock.clock == "continuous")]))[0]
        _restamp(at, begin, physics.sample_interval_s)


def _seconds(physics: Physics, truth, speed_m_s: float) -> float:
    return physics.start_s[1] + (truth.vehicle.axles[-1].x_m + physics.bump_length_m) / speed_m_s + RINGING_S


def _restamp(file: Path, begin_s: float, interval_s: float) -> None:
    head, *rows = file.read_text(encoding="utf-8").splitlines()
    lines = [f"{begin_s + k * interval_s:.6f},{row.split(',', 1)[1]}" for k, row in enumerate(rows)]
    file.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def _runs(folder: Path) -> list[tuple[str, str, float, float]]:
    import tomllib

    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
    return [
        (run["file"], Path(run["file"]).name.split("_")[0], run["speed_m_s"], run["start_s"])
        for run in truth["bump_run"]
    ]
