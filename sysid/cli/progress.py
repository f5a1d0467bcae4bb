"""A progress bar with the time left, on the error stream so that printed results stay clean."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class StageProgress:
    """Progress of the running stage; on a stream that is no terminal it prints a line now and then instead."""

    def __init__(self, console: Console):
        self._console = console
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(elapsed_when_finished=False),
            console=console,
            transient=True,
            refresh_per_second=4,
        )
        self._task: TaskID | None = None
        self._last = ""

    def __enter__(self) -> StageProgress:
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._console.is_terminal:
            self._bar.stop()

    def stage(self, name: str) -> None:
        """Begin a new stage."""
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._task = self._bar.add_task(name, total=1.0)

    def update(self, message: str, fraction: float) -> None:
        """Say what is being done and which share of the stage is done."""
        if self._task is None:
            self.stage(message)
        if self._task is not None:
            self._bar.update(self._task, description=message, completed=fraction)
        topic = message.split(",")[0]
        if not self._console.is_terminal and topic != self._last:
            self._last = topic
            self._console.print(f"{topic} ...", markup=False)
