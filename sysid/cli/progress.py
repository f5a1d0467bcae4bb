"""A progress bar with the time left, on the error stream so that printed results stay clean."""

from __future__ import annotations

import threading
import time
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn
from rich.text import Text

#: A stream that is no terminal gets a line at least this often [s].
_SILENCE_S = 10.0
#: Share of the work and seconds before which nobody is told how long the rest takes.
_EARLY, _EARLY_S = 0.05, 3.0
#: Widest description in the bar.
_WORDS = 36


class TimeLeft:
    """Time that the rest of a computation takes, from the share that is done; what is shown never grows.

    t = T (1 - f) / f, T the time since the start and f the share.  An estimate that rises, as at a part that takes
    longer than its share, leaves the shown time where it is.
    """

    def __init__(self) -> None:
        self._shown: float | None = None

    def __call__(self, elapsed_s: float, fraction: float) -> float | None:
        """Seconds left after `elapsed_s` seconds with `fraction` done; None while it is too early to say."""
        if fraction < _EARLY or elapsed_s < _EARLY_S:
            return None
        left = elapsed_s * (1.0 - fraction) / fraction
        self._shown = left if self._shown is None else min(self._shown, left)
        return self._shown


def time_words(seconds: float | None) -> str:
    """``about 3 min left``; empty where it is not known."""
    if seconds is None:
        return ""
    if seconds >= 90.0:
        return f"about {seconds / 60.0:.0f} min left"
    return f"about {10.0 * max(1, round(seconds / 10.0)):.0f} s left"


class _Left(ProgressColumn):
    """The words of a task's time left."""

    def render(self, task: Task) -> Text:
        return Text(task.fields["left"])


class StageProgress:
    """Progress of a command as one bar that never falls back.

    On a stream that is no terminal it prints a line for every stage, and one every ten seconds in between.
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
        self._left_s: float | None = None
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
            self._left_s = self._time_left(time.monotonic() - self._begin, self._fraction)
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
        words, left = escape(words), time_words(self._left_s)
        if self._task is None:
            self._task = self._bar.add_task(words, total=1.0, completed=self._fraction, left=left)  # type: ignore[arg-type]
        else:
            self._bar.update(self._task, description=words, completed=self._fraction, left=left)

    def _print(self, message: str) -> None:
        share = f", {100.0 * self._fraction:.0f} %" if self._fraction else ""
        left = time_words(self._left_s)
        self._said = time.monotonic()
        self._console.print(f"{message}{share}{left and ', ' + left} ...", markup=False)

    def _speak(self) -> None:
        """Print a line wherever none has come for a while."""
        while not self._ended.wait(0.5):
            with self._lock:
                if self._message and time.monotonic() - self._said >= _SILENCE_S:
                    self._print(f"{time.monotonic() - self._begin:.0f} s: {self._message}")
