"""Compiles the native engine beside other work, so that it is there when it is needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Thread

from sysid.threads import thread_count
from sysid.vehicle_model.native import build
from sysid.vehicle_model.native.build import BuildError

#: How long to wait for a thread between two attempts to end its compiler [s].
_PATIENCE_S = 0.1


@contextmanager
def compiled_ahead(coordinates: Sequence[int]) -> Iterator[None]:
    """While the block runs, compile the engine for these numbers of body coordinates, one after the other.

    Who needs one of them meanwhile waits for it. What is not compiled when the block ends is given up. With one thread,
    or where nothing can be compiled, nothing happens.
    """
    if thread_count() == 1 or not coordinates:
        yield
        return
    thread = Thread(target=_compile, args=(coordinates,), name="compiler", daemon=True)
    thread.start()
    try:
        yield
    finally:
        while thread.is_alive():
            build.end_compiler_of(thread)
            thread.join(_PATIENCE_S)


def _compile(coordinates: Sequence[int]) -> None:
    # Who needs the engine is told why there is none; the first failure, or a compiler that is ended, ends all.
    with suppress(BuildError):
        for number in coordinates:
            build.library(number)
