"""The study of faults: every fault changes a campaign, cases follow from their number, and endings are counted."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from studies.faults.bookkeeping import load_cases_exchanged
from studies.faults.campaign_copy import CampaignCopy, DoesNotApply
from studies.faults.case import FAULTS, draw
from studies.faults.table import failed, table, write

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


@pytest.fixture
def copy(tmp_path: Path) -> CampaignCopy:
    shutil.copytree(DATA, tmp_path / "campaign")
    return CampaignCopy(tmp_path / "campaign", np.random.default_rng(1))


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("name", sorted(FAULTS))
def test_every_fault_changes_the_linear_truck(name: str, copy: CampaignCopy) -> None:
    before = content(copy.folder)
    said = FAULTS[name](copy)
    assert said
    assert content(copy.folder) != before


def test_load_cases_are_exchanged_in_the_runs_alone(copy: CampaignCopy) -> None:
    before = copy.text
    load_cases_exchanged(copy)
    runs = [text.count('load_case = "loaded"  , nominal') for text in (before, copy.text)]
    assert runs != [0, 0]
    assert runs[0] != runs[1]
    assert "[load_case.unloaded]" in copy.text


def test_a_fault_that_finds_nothing_to_change_says_so(copy: CampaignCopy) -> None:
    with pytest.raises(DoesNotApply):
        copy.rescale("no_such_key", lambda: 2.0)


def test_cases_follow_from_their_number_and_use_every_fault() -> None:
    assert draw(17)[:2] == draw(17)[:2]
    assert {draw(n)[1][0] for n in range(len(FAULTS))} == set(FAULTS)


def test_endings_are_counted_and_written(tmp_path: Path) -> None:
    made = [
        {"code": 0, "traceback": "", "faults": ["plank height"], "number": 0},
        {"code": 3, "traceback": "", "faults": ["clipped"], "number": 1},
        {"code": 1, "traceback": "Traceback", "faults": ["clipped"], "number": 2},
    ]
    assert [failed(r) for r in made] == [False, False, True]
    shown = table(made)
    assert "| done, exit 0 | 1 | 0 | 1 |" in shown
    assert "| unexpected error, exit 1 | 0 | 1 | 1 |" in shown
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- faults: begin -->\nold\n<!-- faults: end -->\nafter\n", encoding="utf-8")
    write(made, "check", 5, page)
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "3 cases with 2 kinds of faults" in text
    assert "old" not in text
