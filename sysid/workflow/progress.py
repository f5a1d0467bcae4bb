"""Progress over several stages: which of how many is running, how far all of them are, and how long each part took."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext

from sysid.cell_progress import watched_cell
from sysid.progress import Progress, unwatched


class Steps:
    """Progress of planned steps as one fraction that never falls, and the seconds of every part of a step.

    A part begins with a message and lasts until one that begins with other words, up to the first comma.  Steps that
    were not planned (exports after a single stage) are timed but not reported.

    Parameters
    ----------
    report : callback (message, fraction of everything planned); without one a notebook shows a line below its cell.
    """

    def __init__(self, report: Progress | None = None):
        self._given, self._report = report, report or unwatched
        self._plan: dict[str, float] = {}
        self._done: set[str] = set()
        self._step = ""
        self._reached = 0.0
        self._part, self._since = "", 0.0
        #: Seconds of the parts of the steps that have run, ``step: part``.
        self.parts: dict[str, float] = {}

    @contextmanager
    def planned(self, efforts: Mapping[str, float]) -> Iterator[None]:
        """Say which steps will run and how much of the time each takes; within another plan, that plan continues."""
        if self._plan:
            yield
            return
        self._plan, self._done, self._reached = dict(efforts), set(), 0.0
        with watched_cell(list(efforts)) if self._given is None else nullcontext(self._given) as self._report:
            try:
                yield
            finally:
                self._plan = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Run a step, also within another one."""
        outer = self._step
        self.parts = {key: value for key, value in self.parts.items() if not key.startswith(f"{name}: ")}
        self._step, self._part = name, ""
        if self._place:
            self._say(self._place, 0.0)
        try:
            yield
        finally:
            self._end_part()
            self._done.add(name)
            self._step = outer

    def __call__(self, message: str, fraction: float) -> None:
        """Say what the running step does and which share of it is done."""
        part = message.split(",")[0]
        if part != self._part:
            self._end_part()
            self._part, self._since = part, time.perf_counter()
        self._say(f"{self._place}: {message}" if self._place else message, fraction)

    @property
    def _place(self) -> str:
        """``3 of 8 scan``; empty where there is one step only."""
        if len(self._plan) < 2 or self._step not in self._plan:
            return ""
        return f"{list(self._plan).index(self._step) + 1} of {len(self._plan)} {self._step}"

    def _say(self, message: str, fraction: float) -> None:
        if self._step not in self._plan:
            return
        before = sum(effort for name, effort in self._plan.items() if name in self._done)
        reached = before + min(max(fraction, 0.0), 1.0) * self._plan[self._step]
        self._reached = max(self._reached, reached / sum(self._plan.values()))
        self._report(message, self._reached)

    def _end_part(self) -> None:
        if self._part and self._step:
            key = f"{self._step}: {self._part}"
            self.parts[key] = self.parts.get(key, 0.0) + time.perf_counter() - self._since
        self._part = ""
