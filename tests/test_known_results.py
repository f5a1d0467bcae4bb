"""What was computed before: the same for the same content, anew for any other, forgotten when it is of no more use."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sysid.known_results import KnownResults


@dataclass(frozen=True)
class _Record:
    name: str
    value: np.ndarray
    further: tuple[object, ...] = ()


_RECORD = _Record("lvdt1_mm", np.arange(4.0), (1.0, frozenset({2, 3}), {"a": "b"}))


class _Sum:
    """A sum that counts how often it was computed."""

    def __init__(self) -> None:
        self.known, self.calls = KnownResults(), 0

    def compute(self, record: _Record, factor: float) -> float:
        self.calls += 1
        return factor * float(record.value.sum())

    def of(self, record: _Record) -> float:
        return self.known.of(self.compute, record, 2.0)


def test_the_same_content_is_computed_once() -> None:
    made = _Sum()
    # Another object of the same content, as after reading a file again.
    again = replace(_RECORD, value=_RECORD.value.copy())
    assert [made.of(_RECORD), made.of(again)] == [12.0, 12.0]
    assert made.calls == 1


@pytest.mark.parametrize(
    "other",
    [
        replace(_RECORD, name="lvdt2_mm"),
        replace(_RECORD, value=np.array([0.0, 1.0, 2.0, 3.0 + 1e-12])),
        replace(_RECORD, value=_RECORD.value.reshape(2, 2)),
        replace(_RECORD, value=_RECORD.value.astype(np.float32)),
        replace(_RECORD, further=(1, frozenset({2, 3}), {"a": "b"})),
        replace(_RECORD, further=(1.0, frozenset({2}), {"a": "b"})),
        replace(_RECORD, further=((1.0, frozenset({2, 3})), {"a": "b"})),
        replace(_RECORD, further=(1.0, frozenset({2, 3}), {"a": "c"})),
    ],
)
def test_any_other_content_is_computed(other: _Record) -> None:
    made = _Sum()
    made.of(_RECORD)
    made.of(other)
    assert made.calls == 2


def test_what_was_not_asked_for_is_forgotten() -> None:
    made = _Sum()
    made.of(_RECORD)
    made.known.forget_unused()
    made.of(_RECORD)
    assert made.calls == 1
    # Nothing asked for it between two calls.
    made.known.forget_unused()
    made.known.forget_unused()
    made.of(_RECORD)
    assert made.calls == 2


@pytest.mark.parametrize("unknown", [object(), np.array([object()], dtype=object)])
def test_content_that_is_not_known_is_no_key(unknown: object) -> None:
    """Their words hold a place in memory, which another object may have later."""
    with pytest.raises(TypeError, match="not known"):
        KnownResults().of(repr, unknown)
