"""Progress below the cell of a notebook: one line that changes while the cell computes."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from sysid.progress import Progress, TimeLeft, time_words, unwatched

#: How often the line changes [s].
_EVERY_S = 0.5


@contextmanager
def watched_cell(names: Sequence[str]) -> Iterator[Progress]:
    """The :data:`sysid.progress.Progress` of what somebody computes in a cell; elsewhere than in a notebook nothing.

    At the end the line says what has been computed, and nothing of how long it took: it is stored with the notebook.

    Parameters
    ----------
    names : what is computed, in order.
    """
    display = _display()
    if display is None or not names:
        yield unwatched
        return
    line = _Line(display, names[0])
    try:
        yield line
    except BaseException:
        line.end("Stopped.")
        raise
    line.end(f"Computed: {', '.join(names)}.")


def _display() -> Any:
    """What shows an output that can be changed later, in a process that works for a notebook."""
    ipython: Any = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return ipython.display.display if hasattr(shell, "kernel") else None


class _Line:
    """One line, renewed by a thread: whoever computes only leaves word."""

    def __init__(self, display: Any, message: str) -> None:
        self._message, self._fraction = message, 0.0
        self._begin, self._time_left = time.monotonic(), TimeLeft()
        self._handle = display(_plain(self._words()), raw=True, display_id=True)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._renew, daemon=True)
        self._thread.start()

    def __call__(self, message: str, fraction: float) -> None:
        """Say what is being done and which share of all is done."""
        self._message, self._fraction = message, max(self._fraction, fraction)

    def end(self, words: str) -> None:
        """Leave these words in place of the line."""
        self._ended.set()
        self._thread.join()
        self._handle.update(_plain(words), raw=True)

    def _words(self) -> str:
        elapsed_s = time.monotonic() - self._begin
        left = time_words(self._time_left(elapsed_s, self._fraction))
        return f"{self._message}, {100.0 * self._fraction:.0f} %, {elapsed_s:.0f} s{left and ', ' + left} ..."

    def _renew(self) -> None:
        while not self._ended.wait(_EVERY_S):
            self._handle.update(_plain(self._words()), raw=True)


def _plain(text: str) -> dict[str, str]:
    return {"text/plain": text}
