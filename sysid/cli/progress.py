"""A progress bar with the time left, on the error stream so that printed results stay clean."""

from __future__ import annotations

import threading
import time
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn
from rich.text import Text

from sysid.progress import TimeLeft, time_words

#: A stream that is no terminal gets a line at least this often [s].
SILENCE_S = 5.0
#: Widest description in the bar.
_WORDS = 36


class _Left(ProgressColumn):
    """The words of a task's time left."""

    def render(self, task: Task) -> Text:
        return Text(time_words(task.fields["left"]()))


class StageProgress:
    """Progress of a command as one bar that never falls back.

    On a stream that is no terminal it prints a line for every stage, and one every five seconds in between.
    """

    def __init__(self, console: Console):
        self._console = console
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=12),
            TextColumn("{task.percentage:>3.0f} %"),
            _Left(),
            console=console,
            transient=True,
            refresh_per_second=4,
        )
        self._task: TaskID | None = None
        self._topic = self._message = ""
        self._fraction = 0.0
        self._time_left = TimeLeft()
        self._begin = self._said = time.monotonic()
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._speaker = threading.Thread(target=self._speak, daemon=True)

    def __enter__(self) -> StageProgress:
        if self._console.is_terminal:
            self._bar.start()
        else:
            self._speaker.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._console.is_terminal:
            self._bar.stop()
        else:
            self._speaker.join()

    def stage(self, name: str) -> None:
        """Say that something begins of which it is not known yet how long it takes."""
        self.update(name, self._fraction)

    def update(self, message: str, fraction: float) -> None:
        """Say what is being done and which share of all is done."""
        with self._lock:
            self._message = message
            self._fraction = max(self._fraction, min(fraction, 1.0))
            if self._console.is_terminal:
                self._draw()
                return
            topic = message.split(",")[0].split(":")[0]
            if topic != self._topic:
                self._topic = topic
                self._print(topic)

    def _draw(self) -> None:
        words = self._message
        if len(words) > _WORDS:
            words = f"{words[: _WORDS - 1]}\N{HORIZONTAL ELLIPSIS}"
        words = escape(words)
        if self._task is None:
            self._task = self._bar.add_task(words, total=1.0, completed=self._fraction, left=self._left_s)  # type: ignore[arg-type]
        else:
            self._bar.update(self._task, description=words, completed=self._fraction)

    def _left_s(self) -> float | None:
        """Seconds left, at this moment."""
        return self._time_left(time.monotonic() - self._begin, self._fraction)

    def _print(self, message: str) -> None:
        share = f", {100.0 * self._fraction:.0f} %" if self._fraction else ""
        left = time_words(self._left_s())
        self._said = time.monotonic()
        self._console.print(f"{message}{share}{left and ', ' + left} ...", markup=False)

    def _speak(self) -> None:
        """Print a line wherever none has come for a while."""
        while not self._ended.wait(0.5):
            with self._lock:
                if self._message and time.monotonic() - self._said >= SILENCE_S:
                    self._print(f"{time.monotonic() - self._begin:.0f} s: {self._message}")
