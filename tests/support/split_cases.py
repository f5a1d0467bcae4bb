"""Cases of a test that takes seconds: one with every commit, the others with the long tests."""

from __future__ import annotations

from typing import Any

import pytest


def first_then_long(first: Any, *others: Any) -> list[Any]:
    """Values for one argument of a test: all but the first get the marker `long`."""
    return [first, *(pytest.param(other, marks=pytest.mark.long) for other in others)]
