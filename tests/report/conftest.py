"""Makes the shared builders of `tests/support` importable; pages that several files look at, rendered once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from hostile_text import HOSTILE
from small_results import Words, small_results

from sysid.report import render_report


@pytest.fixture(scope="session")
def full_text():
    return render_report(small_results())


@pytest.fixture(scope="session")
def hostile_text():
    return render_report(small_results(Words.all(HOSTILE)))
