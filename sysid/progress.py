"""How a long computation reports how far it is."""

from __future__ import annotations

from collections.abc import Callable

#: Called with what is running and the fraction of it that is done, 0 to 1.
Progress = Callable[[str, float], None]


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
