"""One folder: `run --resume` in child processes that are killed, and what the folder holds in the end.

The children are forked from a process that has imported everything and computed nothing, so a life has not to load the
program first.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from studies.coverage.shards import Record
from studies.damages.case import RUN, base

SEED = 2028
#: Lives of one folder that are killed; the next one may live.
MOST_KILLS = 25
LIMIT_S = 7200.0
#: One life in so many ends before its first word, within so many seconds; the others in the stage where the one before
#: ended or, at the most, so many stages later.
_EARLY, _EARLY_S, _STAGES_ON = 10, 2.0, 2
LOADED = ("sysid.cli.stages", "sysid.workflow.calibration", "sysid.workflow.stages.fit", "sysid.report",
           "sysid.export.models", "sysid.export.tables", "sysid.export.inference_data", "sysid.posterior.sampling",
           "sysid.posterior.log_density", "sysid.prediction.predict_passes", "sysid.prediction.run_bands",
           "sysid.planning.ranking", "sysid.validation.channel_agreement", "filelock", "matplotlib.figure")  # fmt: skip
_BEFORE = "before the first stage"
_STAGE = re.compile(r"\d+ of \d+ ([a-z_]+)")


def replicate(number: int, bases: Path, seed: int = SEED) -> Record:
    """Where one folder's lives were killed, how the last one ended, and what differs from the undisturbed folder."""
    for name in LOADED:
        importlib.import_module(name)
    campaign, good = base(bases)
    rng = np.random.default_rng([seed, number])
    seconds = _stage_seconds(good)
    stages = list(seconds)
    at, killed = 0, list[str]()
    with tempfile.TemporaryDirectory() as place:
        output = Path(place) / "output"
        while True:
            stage, pause = None, _EARLY_S
            if rng.integers(_EARLY):
                stage = stages[min(at + int(rng.integers(_STAGES_ON + 1)), len(stages) - 1)]
                pause = seconds[stage]
            end = (stage, float(rng.uniform(0.0, pause))) if len(killed) < MOST_KILLS else None
            code, said = _life(campaign, output, Path(place) / "said", end, stages)
            if code != -signal.SIGKILL:
                break
            killed.append(said)
            at = max(at, stages.index(said)) if said in stages else at
        wrong = [] if code == 0 else [f"exit code {code}: {said}"]
        if code == 0:
            wrong += differences(output, good)
    return {"number": number, "killed": killed, "code": code, "wrong": wrong}


def _stage_seconds(good: Path) -> dict[str, float]:
    """Stages in their order, with the time that each took in the undisturbed folder [s]."""
    timings = json.loads((good / "stages" / "timings.json").read_text(encoding="utf-8"))
    return {name: seconds for name, seconds in timings.items() if ": " not in name}


def _life(
    campaign: Path, output: Path, said: Path, end: tuple[str | None, float] | None, stages: list[str]
) -> tuple[int, str]:
    """A child that goes on with the run; exit code (-9: killed) and its last stage, or its last words.

    It is killed when it has begun one of the stages from that on which `end` names (None: itself), and a pause is over.
    """
    said.write_text("", encoding="utf-8")
    child = os.fork()
    if child == 0:
        _live(campaign, output, said)
    began = time.monotonic()
    while time.monotonic() - began < LIMIT_S:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), said.read_text(encoding="utf-8")[-1500:]
        if end is not None and (end[0] is None or {*stages[stages.index(end[0]) :]} & {*_progress(said)}):
            time.sleep(end[1])
            end = None
            if os.waitpid(child, os.WNOHANG)[0] == 0:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return -signal.SIGKILL, (_progress(said) or [_BEFORE])[-1]
            return 0, ""
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1, f"not done within {LIMIT_S:g} s"


def _live(campaign: Path, output: Path, said: Path) -> None:
    """What the child does: the command, its words into a file, and no way back."""
    code = 1
    try:
        stream = said.open("w", encoding="utf-8", buffering=1)
        sys.stdout = sys.stderr = stream
        from sysid.cli.main import cli

        cli(["run", str(campaign), "--resume", *RUN, "--output", str(output)], prog_name="calibrate.py")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    finally:
        sys.stdout.flush()
        os._exit(code)


def _progress(said: Path) -> list[str]:
    return _STAGE.findall(said.read_text(encoding="utf-8", errors="replace"))


def differences(output: Path, good: Path) -> list[str]:
    """What the folder holds that an undisturbed one does not: other numbers, other files, files half-written."""
    found, expected = _files(output), _files(good)
    # Times stand in these, or follow from them.
    timed = (
        "files.json",
        "result.json",
        "report.html",
        "stages/timings.json",
        "stages/settings.json",
        "posterior.nc",
    )
    wrong = [f"{name} is missing or too much" for name in sorted(found.keys() ^ expected.keys())]
    wrong += [f"{name} differs" for name in found.keys() & expected.keys() - {*timed} if found[name] != expected[name]]
    if _result(output) != _result(good):
        wrong.append("result.json differs")
    return wrong


def _files(folder: Path) -> dict[str, bytes]:
    """Contents by name, without the date of the result, which exported files carry."""
    result = folder / "result.json"
    known = json.loads(result.read_text(encoding="utf-8")) if result.is_file() else {}
    date = known.get("identity", {}).get("date", "").encode()
    found = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    return {name: content.replace(date, b"") if date else content for name, content in found.items()}


def _result(folder: Path) -> dict[str, Any]:
    document = dict(json.loads((folder / "result.json").read_text(encoding="utf-8")))
    del document["timings"]
    document.get("identity", {}).pop("date", None)
    return document
