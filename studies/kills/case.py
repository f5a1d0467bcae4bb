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
#: A life is killed after so many lines of progress, at the most, and a pause.
_LINES, _PAUSE_S = 7, 1.0
_LOADED = ("sysid.cli.stages", "sysid.workflow.calibration", "sysid.workflow.stages.fit", "sysid.report",
           "sysid.export.models", "sysid.export.tables", "sysid.export.inference_data", "sysid.posterior.sampling",
           "sysid.posterior.log_density", "sysid.prediction.predict_passes", "sysid.prediction.run_bands",
           "sysid.planning.advise", "sysid.validation.channel_agreement", "filelock", "matplotlib.figure")  # fmt: skip
_STAGE = re.compile(r"\d+ of \d+ ([a-z_]+)")


def replicate(number: int, bases: Path, seed: int = SEED) -> Record:
    """Where one folder's lives were killed, how the last one ended, and what differs from the undisturbed folder."""
    for name in _LOADED:
        importlib.import_module(name)
    campaign, good = base(bases)
    rng = np.random.default_rng([seed, number])
    killed: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        output = Path(place) / "output"
        while True:
            # The first lives of a folder end anywhere in the program, also before its first word.
            lines = int(rng.integers(0, _LINES)) if len(killed) < MOST_KILLS else None
            code, said = _life(campaign, output, Path(place) / "said", lines, float(rng.uniform(0.0, _PAUSE_S)))
            if code != -signal.SIGKILL:
                break
            killed.append(said)
        wrong = [] if code == 0 else [f"exit code {code}: {said}"]
        if code == 0:
            wrong += differences(output, good)
    return {"number": number, "killed": killed, "code": code, "wrong": wrong}


def _life(campaign: Path, output: Path, said: Path, lines: int | None, pause: float) -> tuple[int, str]:
    """A child that goes on with the run; exit code (-9: killed) and its last line of progress, or its last words."""
    said.write_text("", encoding="utf-8")
    child = os.fork()
    if child == 0:
        _live(campaign, output, said)
    began = time.monotonic()
    while time.monotonic() - began < LIMIT_S:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), said.read_text(encoding="utf-8")[-1500:]
        if lines is not None and len(_progress(said)) >= lines:
            time.sleep(pause)
            lines = None
            if os.waitpid(child, os.WNOHANG)[0] == 0:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return -signal.SIGKILL, (_progress(said) or ["before the first stage"])[-1]
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
    timed = ("result.json", "report.html", "stages/timings.json", "posterior.nc")
    wrong = [f"{name} is missing or too much" for name in sorted(found.keys() ^ expected.keys())]
    wrong += [f"{name} differs" for name in found.keys() & expected.keys() - {*timed} if found[name] != expected[name]]
    if _result(output) != _result(good):
        wrong.append("result.json differs")
    return wrong


def _files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _result(folder: Path) -> dict[str, Any]:
    document = dict(json.loads((folder / "result.json").read_text(encoding="utf-8")))
    del document["timings"]
    return document
