"""Commands of the program that run beside the watch, one after the other; what is no longer of use is stopped."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sysid.files import make_folder

#: Exit codes after which the results count: done, data rejected, not converged.
_RESULTS = (0, 3, 4)
#: How long a command may take to stop when it is asked to [s].
_PATIENCE_S = 10.0
_PARENT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Task:
    """A command on a campaign file, the folder of its results, and the hashes of the logs that it works on."""

    command: str
    campaign: Path
    output: Path
    logs: frozenset[str]

    @property
    def words(self) -> str:
        """What it does, in words."""
        of_drop = {"drops": "k and c of a drop", "balance": "force balance", "fit": "fit", "advise": "advice"}
        return of_drop.get(self.command, self.command)


class Background:
    """At most one process at a time, of this interpreter."""

    def __init__(self, environment: dict[str, str] | None = None):
        self._environment = environment or {}
        self._process: subprocess.Popen[bytes] | None = None
        self._task: Task | None = None
        self._waiting: list[Task] = []

    @property
    def busy(self) -> bool:
        """Whether something runs or waits."""
        return self._task is not None or bool(self._waiting)

    @property
    def words(self) -> str:
        """What runs now, empty if nothing does."""
        return "" if self._task is None else self._task.words

    def want(self, tasks: Sequence[Task]) -> None:
        """From now on these are to be done, in this order; what runs goes on only if it is one of them."""
        if self._task is not None and self._task not in tasks:
            self.stop()
        self._waiting = [task for task in tasks if task != self._task]

    def turn(self) -> tuple[Task, bool] | None:
        """Start what is next; a task that has ended since the last turn, and whether its results count."""
        ended = None
        if self._process is not None and self._task is not None and self._process.poll() is not None:
            ended = (self._task, self._process.returncode in _RESULTS)
            self._process, self._task = None, None
            if not ended[1]:
                # What follows rests on it.
                self._waiting = [t for t in self._waiting if t.output != ended[0].output]
        if self._process is None and self._waiting:
            self._task = self._waiting.pop(0)
            make_folder(self._task.output)
            words = [self._task.command, str(self._task.campaign), "--output", str(self._task.output), "--quick"]
            if self._task.command != "drops":
                words.append("--resume")
            path = os.pathsep.join(filter(None, (str(_PARENT), os.environ.get("PYTHONPATH", ""))))
            self._process = subprocess.Popen(
                [sys.executable, "-m", "sysid", *words],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": path, **self._environment},
            )
        return ended

    def stop(self) -> None:
        """Stop what runs, and forget what waits."""
        process, self._process, self._task, self._waiting = self._process, None, None, []
        if process is None:
            return
        process.terminate()
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
