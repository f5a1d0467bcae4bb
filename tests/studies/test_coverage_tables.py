"""Tables of the coverage studies: ranks whose answer is known, and shards that go on where they stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from studies.coverage import shards
from studies.coverage.drops import deflection
from studies.coverage.shards import collect, fill, sources
from studies.coverage.tables import HEADING, binomial_bound, held, rank_table, section, uniform_probability, write


def test_ranks_of_draws_from_the_truths_own_distribution_are_uniform_and_narrow_ones_are_not():
    random = np.random.default_rng(1)
    draws = np.sort(random.standard_normal((2000, 99)), axis=1)
    honest = (draws < random.standard_normal((2000, 1))).sum(axis=1)
    assert uniform_probability(honest) > 0.001
    assert held(honest, 0.9) == pytest.approx(0.9, abs=0.03)
    assert held(honest, 0.5) == pytest.approx(0.5, abs=0.05)
    narrow = (0.5 * draws < random.standard_normal((2000, 1))).sum(axis=1)
    assert uniform_probability(narrow) < 1e-6
    # A normal truth inside half of its 90 % interval: P(|z| < 1.645 / 2).
    assert held(narrow, 0.9) == pytest.approx(0.589, abs=0.04)


def test_every_rank_once_is_held_exactly():
    ranks = np.arange(100)
    assert held(ranks, 0.9) == 0.9
    assert held(ranks, 0.5) == 0.5
    assert uniform_probability(ranks) == 1.0
    low, high = binomial_bound(0.9, 400, 1)
    assert (low, high) == pytest.approx((0.8475, 0.945), abs=0.003)


def test_shards_are_computed_once_and_go_on(tmp_path: Path):
    calls = []

    def replicate(number: int):
        calls.append(number)
        return {"number": number, "entries": [{"name": "k", "rank": number, "z": 0.0, "sd": 1.0}]}

    assert list(fill(tmp_path, "drops", range(2), replicate)) == [0, 1]
    assert list(fill(tmp_path, "drops", range(4), replicate)) == [2, 3]
    assert calls == [0, 1, 2, 3]
    assert [r["number"] for r in collect(tmp_path, "drops").records] == [0, 1, 2, 3]
    assert "| `k` | 4 |" in "\n".join(rank_table(collect(tmp_path, "drops").records))


def test_replicates_of_other_code_are_left_out_and_computed_again(tmp_path: Path, monkeypatch):
    def replicate(number: int):
        failed = "no start found." if number == 1 else None
        return {"failed": failed, "entries": [] if failed else [{"name": "k", "rank": number}]}

    list(fill(tmp_path, "bump", range(3), replicate))
    (tmp_path / "bump_0003.json").write_text('{"failed": null, "entries": [{"name": "k", "rank": 9}]}')
    assert (len(collect(tmp_path, "bump").records), collect(tmp_path, "bump").foreign) == (3, 1)
    assert "1 of 3 replicates failed." in section(tmp_path)
    assert list(fill(tmp_path, "bump", range(4), replicate)) == [3]
    monkeypatch.setattr(shards, "sources", lambda: "other")
    assert collect(tmp_path, "bump") == ([], 4)
    assert list(fill(tmp_path, "bump", range(1), replicate)) == [0]


def test_the_mark_follows_the_sources(tmp_path: Path):
    for name in ("sysid/estimation", "sysid/report", "studies"):
        (tmp_path / name).mkdir(parents=True)
    marks = []
    for text in ("a = 1", "a = 2"):
        (tmp_path / "sysid" / "estimation" / "one.py").write_text(text)
        marks.append(sources.__wrapped__(tmp_path))
    (tmp_path / "sysid" / "estimation" / "notes.txt").write_text("no source")
    (tmp_path / "sysid" / "report" / "two.py").write_text("what only shows results")
    marks.append(sources.__wrapped__(tmp_path))
    assert marks[0] != marks[1] == marks[2]


def test_files_that_are_being_written_belong_to_one_process(tmp_path: Path):
    def replicate(number: int):
        # Another process computes the same replicate at the same time.
        (tmp_path / "drops_0000.tmp").write_text("half")
        return {"entries": []}

    list(fill(tmp_path, "drops", range(1), replicate))
    assert (tmp_path / "drops_0000.tmp").read_text() == "half"


def test_only_its_own_section_is_rewritten(tmp_path: Path):
    document = tmp_path / "statistics.md"
    document.write_text(f"# Statistics\n\nkept\n\n{HEADING}\n\nold words\n\n## Other\n\nkept too\n", encoding="utf-8")
    list(fill(tmp_path, "drops", range(1), lambda n: {"entries": [{"name": "k", "rank": 3}]}))
    write(tmp_path, document)
    text = document.read_text(encoding="utf-8")
    assert "old words" not in text
    assert text.count(HEADING) == 1
    assert text.startswith("# Statistics\n\nkept\n")
    assert text.endswith("## Other\n\nkept too\n")


def test_quarter_car_on_a_stiff_tire_decays_like_one_degree_of_freedom():
    mass, stiffness, damping = 3400.0, 4.0e5, 8.0e3
    moved = deflection(stiffness, damping, mass, 1.0, 1e10, 1e4, 0.8)
    after = moved[200:]
    peaks = [i for i in range(1, after.size - 1) if after[i - 1] < after[i] > after[i + 1] and after[i] > 1e-3]
    omega, rate = np.sqrt(stiffness / mass), damping / (2.0 * mass)
    period = 2.0 * np.pi / np.sqrt(omega**2 - rate**2)
    assert np.diff(peaks).mean() * 0.005 == pytest.approx(period, rel=0.01)
    assert np.log(after[peaks[0]] / after[peaks[1]]) == pytest.approx(rate * period, rel=0.02)
