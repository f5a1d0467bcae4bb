"""How a long computation reports how far it is."""

from __future__ import annotations

import math
from collections.abc import Callable

#: Called with what is running and the fraction of it that is done, 0 to 1.
Progress = Callable[[str, float], None]
#: Share of the work and seconds before which nobody is told how long the rest takes.
_EARLY, _EARLY_S = 0.1, 3.0
#: Memory of the recent pace [s].
_RECENT_S = 60.0


def portion(report: Progress, begin: float, end: float) -> Progress:
    """The :data:`Progress` of a part that takes a computation from one fraction to another."""

    def of_part(message: str, fraction: float) -> None:
        report(message, begin + (end - begin) * min(max(fraction, 0.0), 1.0))

    return of_part


class Series:
    """The :data:`Progress` of parts whose number nobody knows before, as searches from one optimum to the next.

    A part begins where the reported fraction falls. Each takes the same share of what is left at its beginning, so the
    whole advances with every part and never falls.

    Parameters
    ----------
    report : callback for the whole.
    share : share of what is left that a part takes; the smaller, the more parts are expected.
    """

    def __init__(self, report: Progress, share: float = 0.1):
        self._report, self._share = report, share
        self._left, self._reached = 1.0, 0.0

    def __call__(self, message: str, fraction: float) -> None:
        """Say what the running part does and which share of it is done."""
        if fraction < self._reached:
            self._left *= 1.0 - self._share
        self._reached = fraction
        self._report(message, 1.0 - self._left * (1.0 - self._share * fraction))


def unwatched(message: str, fraction: float) -> None:
    """The :data:`Progress` of a computation that nobody watches."""


class TimeLeft:
    """Time that the rest of a computation takes, from the share that is done; what is shown always shrinks.

    e = (1 - f) max(T / f, T' / f'), T the time since the start, f the share, T' and f' what came of both in the last
    minute or so.  Where the estimate e lies above the shown time s, as at a part that takes longer than its share or on
    a machine that others begin to use, s falls slower than the clock instead of growing, by ds/dt = -s / e: both reach
    zero together.
    """

    def __init__(self) -> None:
        self._shown: float | None = None
        self._at_s = self._fraction = self._recent_s = self._recent = 0.0

    def __call__(self, elapsed_s: float, fraction: float) -> float | None:
        """Seconds left after `elapsed_s` seconds with `fraction` done; None while it is too early to say."""
        step_s = max(elapsed_s - self._at_s, 0.0)
        memory = math.exp(-step_s / _RECENT_S)
        self._recent_s = memory * self._recent_s + step_s
        self._recent = memory * self._recent + fraction - self._fraction
        self._at_s, self._fraction = elapsed_s, fraction
        if fraction < _EARLY or elapsed_s < _EARLY_S:
            return None
        left = (1.0 - fraction) * max(elapsed_s / fraction, self._recent_s / max(self._recent, 1e-6))
        # One implicit step of the equation, stable for any length.
        self._shown = left if self._shown is None else min(left, self._shown * left / (left + step_s + 1e-9))
        return self._shown


def time_words(seconds: float | None) -> str:
    """``about 3 min left``; empty where it is not known."""
    if seconds is None:
        return ""
    if seconds >= 90.0:
        return f"about {seconds / 60.0:.0f} min left"
    return f"about {10.0 * max(1, round(seconds / 10.0)):.0f} s left"
