"""A folder of the logger looked at once, through the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from half_car import HalfCar, write_campaign

ROOT = Path(__file__).parents[2]


def test_a_dead_sensor_is_named_and_nothing_is_written_beside_the_logs(tmp_path):
    logger = write_campaign(tmp_path / "logger", HalfCar()).parent
    dead = logger / "rear_2.csv"
    lines = dead.read_text(encoding="utf-8").splitlines()
    dead.write_text("\n".join([lines[0], *(f"{line.rsplit(',', 1)[0]},4.2" for line in lines[1:])]) + "\n", "utf-8")
    before = {p.name: p.read_bytes() for p in logger.iterdir()}
    command = [sys.executable, "calibrate.py", "watch", str(logger), "--once", "--no-fit", "--json"]
    done = subprocess.run(
        [*command, "--output", str(tmp_path / "out")], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    (report,) = [json.loads(line) for line in done.stdout.splitlines()]
    answers = {log["file"]: (log["answer"], " ".join(log["reasons"])) for log in report["logs"]}
    assert {name for name, (answer, _) in answers.items() if answer == "good"} == {
        "both_1.csv",
        "both_2.csv",
        "rear_1.csv",
    }
    assert "rear_mm" in answers["rear_2.csv"][1]
    assert "dead" in answers["rear_2.csv"][1]
    assert {p.name: p.read_bytes() for p in logger.iterdir()} == before
