"""Results that were computed before, kept by the content of what they were computed from."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import PurePath
from typing import TypeVar, cast

import numpy as np

T = TypeVar("T")


class KnownResults:
    """Results of pure functions: a day that grows by one log computes only what is new.

    Their arguments hold records, collections, arrays of numbers, texts, numbers and paths. Of anything else the content
    is not known, so that a result could be that of another: TypeError.

    What has not been asked for between two calls of :meth:`forget_unused` is forgotten, so that memory does not grow.
    """

    def __init__(self) -> None:
        self._kept: dict[bytes, object] = {}
        self._used: set[bytes] = set()

    def of(self, compute: Callable[..., T], *given: object) -> T:
        """What a function returns for these arguments; raises TypeError for those whose content is not known."""
        digest = hashlib.sha256(f"{compute.__module__}.{compute.__qualname__}".encode())
        for part in _content(given):
            digest.update(len(part).to_bytes(8, "little") + part)
        key = digest.digest()
        self._used.add(key)
        if key not in self._kept:
            self._kept[key] = compute(*given)
        return cast(T, self._kept[key])

    def forget_unused(self) -> None:
        """Forget what has not been asked for since the last call."""
        self._kept = {key: result for key, result in self._kept.items() if key in self._used}
        self._used = set()


def _content(value: object) -> Iterator[bytes]:
    """All that a value holds, in a fixed order."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"{value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield type(value).__qualname__.encode()
        for field in dataclasses.fields(value):
            yield from _content(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, inner in value.items():
            yield from _content(key)
            yield from _content(inner)
    elif isinstance(value, tuple | list):
        yield f"{type(value).__name__} {len(value)}".encode()
        for inner in value:
            yield from _content(inner)
    elif isinstance(value, set | frozenset):
        yield repr(sorted(map(repr, value))).encode()
    elif value is None or isinstance(value, str | bytes | bool | int | float | complex | np.generic | PurePath):
        yield f"{type(value).__name__} {value!r}".encode()
    else:
        raise TypeError(f"The content of {type(value).__name__} is not known.")
