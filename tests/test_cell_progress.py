"""The line below a cell that computes: it changes without a word from whoever computes, and ends with what was done."""

from __future__ import annotations

import re
import sys
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest

from sysid import cell_progress
from sysid.cell_progress import watched_cell
from sysid.progress import unwatched
from sysid.workflow.progress import Steps


class Shown:
    """What a notebook would show: the texts of one output, and when each came [s]."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.times_s: list[float] = []

    def update(self, data: dict[str, str], raw: bool) -> None:
        assert raw
        self.texts.append(data["text/plain"])
        self.times_s.append(time.monotonic())

    def display(self, data: dict[str, str], raw: bool, display_id: bool) -> Shown:
        assert display_id
        self.update(data, raw)
        return self


@pytest.fixture
def notebook(monkeypatch) -> Shown:
    """A process that works for a notebook."""
    shown = Shown()
    shell = SimpleNamespace(kernel=object())
    ipython = SimpleNamespace(get_ipython=lambda: shell, display=SimpleNamespace(display=shown.display))
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setattr(cell_progress, "_EVERY_S", 0.05)
    return shown


def test_the_line_changes_while_nothing_is_reported(notebook: Shown) -> None:
    with watched_cell(["fit", "sample"]) as report:
        report("1 of 2 fit: searching", 0.2)
        report("1 of 2 fit: again", 0.1)
        time.sleep(0.4)
    assert len(notebook.texts) >= 4
    assert max(b - a for a, b in pairwise(notebook.times_s)) < 0.3
    assert re.fullmatch(r"1 of 2 fit: again, 20 %, \d s \.\.\.", notebook.texts[-2])
    assert notebook.texts[0].startswith("fit, 0 %")
    assert notebook.texts[-1] == "Computed: fit, sample."


def test_an_error_ends_the_line_and_is_not_called_done(notebook: Shown) -> None:
    with pytest.raises(KeyboardInterrupt), watched_cell(["fit"]):
        raise KeyboardInterrupt
    assert notebook.texts[-1] == "Stopped."


def test_what_is_read_back_shows_nothing(notebook: Shown) -> None:
    with watched_cell([]) as report:
        report("x", 0.5)
    assert notebook.texts == []


@pytest.mark.parametrize("shell", [None, SimpleNamespace()], ids=["script", "terminal"])
def test_elsewhere_nobody_is_told(monkeypatch, shell) -> None:
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    with watched_cell(["fit"]) as report:
        assert report is unwatched


def test_stages_tell_a_notebook_which_of_them_were_computed(notebook: Shown) -> None:
    steps = Steps()
    with steps.planned({"check": 1.0, "fit": 9.0}):
        with steps.planned({"check": 1.0}), steps.step("check"):
            steps("reading", 0.5)
        with steps.step("fit"):
            steps("searching", 0.5)
            time.sleep(0.2)
    assert any(text.startswith("2 of 2 fit: searching, 55 %") for text in notebook.texts)
    assert notebook.texts[-1] == "Computed: check, fit."


def test_who_has_a_callback_gets_no_line(notebook: Shown) -> None:
    seen = []
    steps = Steps(lambda message, fraction: seen.append(message))
    with steps.planned({"check": 1.0}), steps.step("check"):
        steps("reading", 0.5)
    assert seen == ["reading"]
    assert notebook.texts == []
