"""The study of damages: every damage changes a folder, every forgery keeps its checksum, differences are seen."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from studies.damages.case import _compared
from studies.damages.files import FILE_DAMAGES
from studies.damages.forgeries import FORGERIES
from studies.damages.table import failures, table, write
from sysid import array_file

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes and sockets are not files on Windows")
FIELDS = {"fingerprint": "f", "result": {"class": "A", "members": {"x": 1.5, "names": ["a", "b"], "none": None}}}


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    path = tmp_path / "fit.npz"
    array_file.write(path, FIELDS, {"array_0": np.arange(6.0).reshape(2, 3) - 2.5, "array_1": np.arange(4.0) + 0.5})
    (tmp_path / "other.npz").write_bytes(b"other")
    return path


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", FILE_DAMAGES)
def test_a_damaged_file_is_none(name: str, seed: int, stage: Path) -> None:
    assert FILE_DAMAGES[name][1](stage, np.random.default_rng(seed))
    assert array_file.read(stage) is None


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", FORGERIES)
def test_a_forged_file_has_a_right_checksum_and_another_content(name: str, seed: int, stage: Path) -> None:
    import hashlib

    before = stage.read_bytes()
    assert FORGERIES[name][1](stage, np.random.default_rng(seed))
    after = stage.read_bytes()
    assert after != before
    assert hashlib.sha256(after[:-64]).hexdigest().encode() == after[-64:]


def test_another_number_is_a_difference_and_a_missing_one_only_after_a_run() -> None:
    whole = {"a": [1.0, 2.0], "timings": 1, "b": {"c": 3}}
    free = ("timings",)
    assert list(_compared({**whole, "timings": 2}, whole, "", True, free)) == []
    assert list(_compared({**whole, "a": [1.0, 2.5]}, whole, "", False, free)) == ["/a/1: 2.5 for 2.0"]
    assert list(_compared({**whole, "a": [], "b": None}, whole, "", False, free)) == []
    assert len(list(_compared({**whole, "a": [], "b": None}, whole, "", True, free))) == 2


def test_the_table_counts_endings_and_failures(tmp_path: Path) -> None:
    good = {"command": "export", "code": 0, "seconds": 1.0, "MB": 3, "wrong": []}
    bad = {**good, "code": 1, "wrong": ["exit code 1"]}
    records = [{"damage": "emptied", "steps": [good, {**good, "code": 3}]}, {"damage": "emptied", "steps": [bad]}]
    assert "| emptied | 2 | 3 | 1 | 1 | 1 |" in table(records)
    assert failures(records[1]) == ["export: exit code 1"]
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- damages: begin -->\nold\n<!-- damages: end -->\nb\n", encoding="utf-8")
    write(json.loads(json.dumps(records)), 1, page)
    assert "old" not in page.read_text(encoding="utf-8")
    assert "2 damages, seed 1" in page.read_text(encoding="utf-8")
