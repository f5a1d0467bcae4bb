"""How a long computation reports how far it is."""

from __future__ import annotations

from collections.abc import Callable

#: Called with what is running and the fraction of it that is done, 0 to 1.
Progress = Callable[[str, float], None]


def unwatched(message: str, fraction: float) -> None:
    """The :data:`Progress` of a computation that nobody watches."""
