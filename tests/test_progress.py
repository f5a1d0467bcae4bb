"""How far a computation is: portions of it, and parts whose number is not known."""

from __future__ import annotations

import pytest

from sysid.progress import Series, portion


def test_a_portion_goes_from_its_begin_to_its_end() -> None:
    seen: list[tuple[str, float]] = []
    part = portion(lambda message, fraction: seen.append((message, fraction)), 0.5, 0.7)
    for fraction in (0.0, 0.5, 1.0, 3.0, -1.0):
        part("a", fraction)
    assert [message for message, _ in seen] == ["a"] * 5
    assert [fraction for _, fraction in seen] == pytest.approx([0.5, 0.6, 0.7, 0.7, 0.5])


def test_a_series_advances_with_every_part_and_never_falls() -> None:
    seen: list[float] = []
    series = Series(lambda message, fraction: seen.append(fraction), 0.25)
    for fraction in (0.0, 0.5, 1.0, 0.0, 1.0, 0.5, 1.0):
        series("a", fraction)
    # Quarters of what is left: of 1, of 3/4, of 9/16.
    assert seen == pytest.approx([0.0, 1 / 8, 1 / 4, 1 / 4, 7 / 16, 7 / 16 + 9 / 128, 37 / 64])
    assert seen == sorted(seen)
