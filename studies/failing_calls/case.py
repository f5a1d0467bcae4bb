"""One command whose n-th call of a kind fails: how it ends, what the folder holds, and what the next command finds.

The commands are given in children that are forked from a process that has imported everything and computed nothing.
"""

from __future__ import annotations

import ctypes
import errno
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studies.damages.case import RUN, base
from studies.kills.case import LOADED, differences
from sysid import array_file

SHIM = Path(__file__).with_name("shim.c")
LIMIT_S = 900.0
#: Numbers of the kinds in the shim, the error that each ends in, and the smallest allocation that counts [bytes].
KINDS = {
    "open": (1, errno.EMFILE), "write": (2, errno.ENOSPC), "rename": (3, errno.EIO), "fsync": (4, errno.EIO),
    "mkdir": (5, errno.EACCES), "unlink": (6, errno.EPERM), "fork": (7, errno.EAGAIN), "malloc": (8, errno.ENOMEM),
}  # fmt: skip
LEAST_BYTES = 200_000
_UNFINISHED = ".writing-"


@dataclass(frozen=True)
class Command:
    """Words after the program's name, with the output folder last, and how its folder is made before."""

    words: tuple[str, ...]
    good: Path


def compiled(folder: Path) -> Path:
    """The shim as a library."""
    target = folder / "failing_calls.so"
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", str(target), str(SHIM), "-ldl"], check=True)
    return target


def commands(bases: Path) -> dict[str, Command]:
    """What is tried, by name."""
    campaign, good = base(bases)
    return {
        "export": Command(("export", str(campaign)), good),
        "report": Command(("report", str(campaign)), good),
        "run --resume": Command(("run", str(campaign), "--resume", *RUN), good),
    }


def every(command: Command, kind: str, step: int = 1, most: int = 10**6) -> Iterator[dict[str, Any]]:
    """Records of every `step`-th call of a kind, until the command ends without having met the failure."""
    for name in LOADED:
        importlib.import_module(name)
    for nth in range(1, most, step):
        record = failing(command, kind, nth)
        if not record["fired"]:
            return
        yield record


def failing(command: Command, kind: str, nth: int) -> dict[str, Any]:
    """What becomes of a command whose n-th call of a kind fails."""
    with tempfile.TemporaryDirectory() as place:
        output = Path(shutil.copytree(command.good, Path(place) / "output"))
        code, said, fired = _in_child([*command.words, "--output", str(output)], Path(place), (kind, nth))
        wrong = [f"exit code {code}: {said}"] if code not in (0, 2, 3, 4) or "Traceback" in said else []
        wrong += broken(output)
        if fired:
            again, last, _ = _in_child([*command.words, "--output", str(output)], Path(place), None)
            wrong += [f"afterwards exit code {again}: {last}"] if again != 0 else []
            wrong += [f"afterwards {d}" for d in differences(output, command.good)]
        return {"kind": kind, "nth": nth, "fired": fired, "code": code, "said": said[-300:], "wrong": wrong}


def broken(output: Path) -> list[str]:
    """Files that are there and not whole."""
    endings: dict[str, Callable[[Path], object]] = {
        ".json": lambda p: json.loads(p.read_bytes()),
        ".npz": lambda p: array_file.read(p) or 1 / 0,
        ".html": lambda p: p.read_bytes().rstrip().endswith(b"</html>") or 1 / 0,
        ".svg": lambda p: p.read_bytes().rstrip().endswith(b"</svg>") or 1 / 0,
        ".csv": lambda p: p.read_bytes().endswith(b"\n") or 1 / 0,
    }
    wrong = []
    for path in sorted(p for p in output.rglob("*") if p.is_file() and not p.name.startswith(_UNFINISHED)):
        try:
            endings.get(path.suffix, lambda p: None)(path)
        except (ValueError, ZeroDivisionError):
            wrong.append(f"{path.relative_to(output)} is not whole")
    return wrong


def _in_child(words: list[str], place: Path, failure: tuple[str, int] | None) -> tuple[int, str, bool]:
    """Exit code, words and whether the failure was met, of a command in a child."""
    said, met = place / "said", place / "met"
    for path in (said, met):
        path.write_text("", encoding="utf-8")
    child = os.fork()
    if child == 0:
        _live(words, said, met, failure)
    began = time.monotonic()
    while time.monotonic() - began < LIMIT_S:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            return code, said.read_text(encoding="utf-8", errors="replace")[-1500:], met.read_text() == "1"
        time.sleep(0.01)
    os.kill(child, 9)
    os.waitpid(child, 0)
    return -1, f"not done within {LIMIT_S:g} s", True


def _live(words: list[str], said: Path, met: Path, failure: tuple[str, int] | None) -> None:
    code, shim = 1, ctypes.CDLL(os.environ["LD_PRELOAD"]) if failure else None
    try:
        stream = said.open("w", encoding="utf-8", buffering=1)
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
        sys.stdout = sys.stderr = stream
        from sysid.cli.main import cli

        if shim is not None and failure is not None:
            number, error = KINDS[failure[0]]
            output = os.fsencode(words[-1])
            shim.failing_calls_arm(number, failure[1], error, ctypes.c_size_t(LEAST_BYTES), output)
        cli(words, prog_name="calibrate.py")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    except BaseException as error:
        sys.stderr.write(f"Traceback: {type(error).__name__}: {error}\n")
    finally:
        if shim is not None:
            met.write_text(str(shim.failing_calls_disarm()), encoding="utf-8")
        sys.stdout.flush()
        os._exit(code)
