"""One case: a result folder, one damage in it, and what the commands of a user make of it."""

from __future__ import annotations

import io
import json
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from studies.coverage.shards import Record
from studies.damages.files import FILE_DAMAGES, Damage
from studies.damages.forgeries import FORGERIES
from studies.process import processor_seconds, reset_peak, status
from studies.small_campaign import ROOT, small_campaign
from sysid.workflow.sources import code_digest

SEED = 2027
#: Beyond what the process held before [bytes].
MOST_BYTES = 500e6
#: Processor time, and time on the clock of a machine that does ten things at once.
LIMIT_S, WAIT_S = 300.0, 3600.0
INTERRUPTED = 130
#: How the base was made, and how an interrupted one goes on; four stretches of a chain.
RUN = ("--quick", "--max-steps", "40")
#: Of so many cases one is reported, of forged ones more, and one computed to its end; all are exported.
REPORT_EVERY, FORGED_REPORT_EVERY, RUN_EVERY = 64, 8, 50
#: What may differ before a run: times, and words that follow from what is there (the engine is named by the fit).
_FREE = ("timings", "identity", "warnings", "status", "seed", "reasons", "engine", "engine_build")


class TooLongError(BaseException):
    """A command did not come to an end; no handler for errors takes it."""


@cache
def base(folder: Path) -> tuple[Path, Path]:
    """Campaign and undamaged result folder, made if they are not there or other code made them."""
    campaign, output = small_campaign(folder / "campaign"), folder / "output"
    mark, code = folder / "code", code_digest(p.stem for p in sorted((ROOT / "sysid").iterdir()) if p.stem[0] != "_")
    if not (output / "SUCCESS").exists() or not mark.exists() or mark.read_text(encoding="utf-8") != code:
        shutil.rmtree(output, ignore_errors=True)
        # In a process of its own: what it compiles would stay in the memory of this one.
        arguments = [sys.executable, "calibrate.py", "run", str(campaign), "--output", str(output), *RUN]
        subprocess.run(arguments, cwd=ROOT, check=True, capture_output=True)
        mark.write_text(code, encoding="utf-8")
    return campaign, output


@cache
def _warmed(folder: Path) -> tuple[Path, Path]:
    """The same; what the program itself takes is loaded before the first case."""
    campaign, output = base(folder)
    with tempfile.TemporaryDirectory() as place:
        copy = Path(shutil.copytree(output, Path(place) / "output"))
        command("export", campaign, copy)
        one, other = (json.loads((p / "result.json").read_text(encoding="utf-8")) for p in (copy, output))
        if list(_compared(one, other, "", True, ("timings", "identity"))):
            raise SystemExit(f"The undamaged folder {output} is not exported as it was; remove it and start again.")
    return campaign, output


def draw(number: int, output: Path, seed: int = SEED) -> tuple[Path, str, Damage, bool, np.random.Generator]:
    """File (relative), name of the damage, the damage, whether the sampled posterior is taken away, random numbers."""
    rng = np.random.default_rng([seed, number])
    stages = sorted(output.glob("stages/*.npz"))
    chain = sorted(output.glob("chain/segment-*.npz"))
    small = sorted(output.glob("stages/*.json"))
    rest = sorted(p for p in output.rglob("*") if p.is_file() and p not in (*stages, *chain, *small))
    group = int(rng.choice(4, p=[0.6, 0.2, 0.08, 0.12]))
    files = (stages, chain, small, rest)[group]
    file = files[int(rng.integers(len(files)))]
    kinds = {**FILE_DAMAGES, **(FORGERIES if group < 2 else {})}
    weights = np.array([weight for weight, _ in kinds.values()])
    name = list(kinds)[int(rng.choice(weights.size, p=weights / weights.sum()))]
    # Without the sampled posterior the commands look at the chain.
    bare = group == 1 and rng.random() < 0.7
    return file.relative_to(output), name, kinds[name][1], bare, rng


def replicate(number: int, bases: Path, seed: int = SEED) -> Record:
    """What the commands say of one damaged folder, and what is wrong with that."""
    campaign, good = _warmed(bases)
    file, name, damage, bare, rng = draw(number, good, seed)
    forged = name in FORGERIES
    expected = json.loads((good / "result.json").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as place:
        output = Path(place) / "output"
        shutil.copytree(good, output)
        done = damage(output / file, rng)
        if bare:
            (output / "stages" / "sample.npz").unlink()
        # A chain that is read alone may be shorter, and says so.
        free = (*_FREE, "posterior") if bare else _FREE
        steps = [_step("export", campaign, output, (), expected, forged, free)]
        if number % (FORGED_REPORT_EVERY if forged else REPORT_EVERY) == 0:
            steps.append(_step("report", campaign, output, (), expected, forged, free))
        if number % RUN_EVERY == 7:
            steps.append(_step("run", campaign, output, ("--resume", *RUN), expected, forged, ("timings", "identity")))
    return {"number": number, "file": file.as_posix(), "damage": name, "done": done, "bare": bare, "steps": steps}


def _step(
    name: str,
    campaign: Path,
    output: Path,
    options: Sequence[str],
    expected: dict[str, Any],
    forged: bool,
    free: Sequence[str],
) -> dict[str, Any]:
    """What a command ends in; parts of the result named in `free` may differ, missing ones only before a run."""
    before = reset_peak()
    began = processor_seconds()
    code, said, errors = command(name, campaign, output, *options)
    seconds, taken = processor_seconds() - began, status("VmHWM") - before
    wrong = []
    log = output / "error.log"
    if code not in (0, 2, 3, 4) or "Traceback" in said + errors:
        wrong.append(f"exit code {code}: " + (log.read_text(encoding="utf-8") if log.is_file() else errors)[-3000:])
    if taken > MOST_BYTES:
        wrong.append(f"{taken / 1e6:.0f} MB")
    found = json.loads((output / "result.json").read_text(encoding="utf-8")) if code == 0 else {}
    differs = list(_compared(found, expected, "", name == "run", free)) if code == 0 else []
    if differs and not forged:
        wrong.append("other numbers: " + ", ".join(differs[:5]))
    sentences = [line for line in errors.splitlines() if not line.rstrip().endswith("...")]
    return {
        "command": name,
        "code": code,
        "seconds": round(seconds, 2),
        "MB": round(taken / 1e6),
        "resident_MB": round(status("VmRSS") / 1e6),
        "said": "\n".join(sentences).replace(str(output.parent), "")[-1500:],
        "believed": bool(differs),
        "wrong": wrong,
    }


def command(name: str, campaign: Path, output: Path, *options: str) -> tuple[int, str, str]:
    """Exit code, output and errors of a command of `calibrate.py` in this process."""
    from sysid.cli.main import cli

    said, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(said), redirect_stderr(errors):
        try:
            with _limited():
                cli([name, str(campaign), "--output", str(output), *options], prog_name="calibrate.py")
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except TooLongError:
            code, _ = -1, errors.write(f"not done within {LIMIT_S:g} s of processor time")
        except Exception as error:
            code, _ = 1, errors.write(f"Traceback: {error!r}")
    if code == INTERRUPTED:
        # Ctrl-C is meant for the study.
        raise KeyboardInterrupt
    return code, said.getvalue(), errors.getvalue()


@contextmanager
def _limited() -> Iterator[None]:
    def interrupt(number: int, frame: object) -> None:
        raise TooLongError

    timers = {signal.SIGALRM: (signal.ITIMER_REAL, WAIT_S), signal.SIGPROF: (signal.ITIMER_PROF, LIMIT_S)}
    before = {number: signal.signal(number, interrupt) for number in timers}
    for timer, seconds in timers.values():
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for number, (timer, _) in timers.items():
            signal.setitimer(timer, 0.0)
            signal.signal(number, before[number])


def _compared(found: Any, expected: Any, place: str, whole: bool, free: Sequence[str]) -> Iterator[str]:
    """Where a result holds another value than expected; what is missing counts only where it must be `whole`."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in found.keys() | expected.keys():
            if key in free:
                continue
            if key not in found or key not in expected:
                yield f"{place}/{key}"
            else:
                yield from _compared(found[key], expected[key], f"{place}/{key}", whole, free)
    elif isinstance(found, list) and isinstance(expected, list):
        if len(found) == len(expected):
            for at, (one, other) in enumerate(zip(found, expected, strict=True)):
                yield from _compared(one, other, f"{place}/{at}", whole, free)
        elif found or whole:
            yield place
    elif found != expected and (whole or found is not None):
        yield f"{place}: {str(found)[:30]} for {str(expected)[:30]}"
