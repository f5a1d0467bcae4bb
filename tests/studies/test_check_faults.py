"""The study of faults through check: every fault changes a campaign, and judging counts what it should."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from studies.check_faults.case import FAMILIES, FAULTS, Copy, Said, judged, without_telling_names
from studies.check_faults.made import EVERYWHERE, Made
from studies.check_faults.table import falsely_accused, fault_table, share_named, write

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
SHIPPED = Path(__file__).parents[2] / "data"


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize(("family", "name"), FAULTS)
def test_every_fault_changes_a_campaign(family: str, name: str, tmp_path: Path) -> None:
    # The linear truck declares no travels.
    source = without_telling_names(SHIPPED if name == "travels in mm" else DATA, tmp_path / "plain")
    copy = Copy(tmp_path / "campaign", np.random.default_rng(11))
    shutil.copytree(source, copy.folder)
    before = content(copy.folder)
    made = FAMILIES[family][name](copy)
    assert made.said
    assert made.words
    assert content(copy.folder) != before


def test_names_that_tell_are_gone(tmp_path: Path) -> None:
    text = (without_telling_names(DATA, tmp_path / "plain") / "campaign.toml").read_text(encoding="utf-8")
    names = re.findall(r'file = "((?:bump_runs|plank_drops)/[^"]+)"', text)
    assert len(names) == 28
    assert all(re.fullmatch(r"(bump_runs/b|plank_drops/p)\d{3}\.csv", n) for n in names)
    assert all((tmp_path / "plain" / n).exists() for n in names)


def said(code: int = 0, sentences=(), accused=()) -> Said:
    return Said(code, frozenset(sentences), frozenset(accused), frozenset(), 10)


def test_endings_are_told_apart() -> None:
    made = Made("a upside down", (r"'a'.*sign",), frozenset(["a"]))
    before = said(sentences=["an old sentence about 'a' and its sign"])
    right = "the channel 'a' has the wrong sign"
    assert judged(made, before, before)["ending"] == "silent"
    assert judged(made, said(sentences=[right]), before)["ending"] == "warned"
    assert judged(made, said(3, [right]), before)["ending"] == "stopped"
    assert judged(made, said(3, ["'b' is wrong"]), before)["ending"] == "other"
    assert judged(made, said(accused=[("r.csv", "a"), ("r.csv", "b")]), before)["falsely"] == ["r.csv, b"]
    everywhere = Made("a clock", ("clock",), frozenset([EVERYWHERE]))
    assert judged(everywhere, said(accused=[("r.csv", "b")]), before)["falsely"] == []


def test_shares_are_counted_and_written(tmp_path: Path) -> None:
    common = {"family": "runs", "falsely": [], "records": 10, "said": "x", "base": "data"}
    made = [
        {**common, "fault": "a", "ending": "warned", "harmless": ""},
        {**common, "fault": "b", "ending": "silent", "harmless": "no reason"},
        {**common, "fault": "c", "ending": "silent", "harmless": "", "falsely": ["r, b"]},
        {**common, "fault": "d", "ending": "does not apply"},
    ]
    assert share_named(made[:3]) == 0.5
    assert falsely_accused(made) == (1, 30)
    assert "| runs | 2 | 0 | 1 | 0 | 1 | 50 % |" in fault_table(made[:3])
    page = tmp_path / "page.md"
    marks = "<!-- check faults: begin -->\nold\n<!-- check faults: end -->\n"
    of_healthy = "<!-- healthy campaigns: begin -->\nolder\n<!-- healthy campaigns: end -->\n"
    page.write_text(f"head\n{marks}{of_healthy}tail\n", encoding="utf-8")
    effects = [
        {"said": "x", "ends": "fitted", "k": 0.01, "c": 0.2},
        {"said": "y", "ends": "same readings", "k": 0.0, "c": 0.0},
    ]
    write(made[:3], [{"number": 1, "accusing": [], "rejected": [], "records": 5}], effects, 3, page)
    text = page.read_text(encoding="utf-8")
    assert "3 cases with 3 faults, seed 3" in text
    assert "2 faults passed on some campaign: 1 change no k" in text
    assert "| x | 1 % | 20 % |" in text
    assert "old" not in text
    assert text.endswith("tail\n")
    # Healthy campaigns that are drawn again leave the faults as they are.
    write([], [{"number": 2, "accusing": ["a is wrong."], "rejected": [], "records": 7}], [], 4, page)
    again = page.read_text(encoding="utf-8")
    assert "Seed 4. 1 healthy campaigns, 7 channel records: 0 records rejected, 1 campaigns with a" in again
    assert "3 cases with 3 faults, seed 3" in again
