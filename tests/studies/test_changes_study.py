"""The study of changes: which pairs change, and what its table counts."""

from __future__ import annotations

import numpy as np

from studies.changes import case
from studies.changes.table import holds, tables
from studies.independent.case import KINDS


def entry(name: str, truth: float, found: float, sd: float, changed: bool) -> dict:
    quantity = "damping" if name.startswith("c") else "stiffness"
    values = {"truth": truth, "log_ratio": found, "log_sd": sd, "changed": changed}
    return {"name": name, "quantity": quantity, **values}


def record(factor: float, *entries: dict, remarks: tuple[str, ...] = (), undecided: str = "") -> dict:
    said = {"remarks": list(remarks), "undecided": undecided}
    return {"factor": factor, "failed": None, "entries": list(entries), "also": [], **said}


def test_every_kind_of_trucks_comes_changed_and_unchanged() -> None:
    kinds = [case.physics_of(n) for n in range(2 * len(KINDS))]
    assert kinds[::2] == kinds[1::2]
    assert len({next(k for k, every in KINDS.items() if p in every) for p in kinds}) == len(KINDS)


def test_the_table_counts_what_is_found_missed_and_wrong() -> None:
    truth = float(np.log(0.9))
    records = [
        record(0.9, entry("c_1", truth, -0.11, 0.01, True), entry("k_1", 0.0, 0.0, 0.01, False)),
        record(0.9, entry("c_1", truth, -0.05, 0.05, False), entry("k_1", 0.0, 0.2, 0.01, True)),
        record(1.0, entry("c_1", 0.0, 0.01, 0.01, False), entry("k_1", 0.0, 0.0, 0.01, False)),
        record(1.0, entry("c_1", 0.0, 0.05, 0.01, True), remarks=("They do not agree on the tires' contact.",)),
        record(0.9, entry("c_1", truth, 0.5, 0.01, False), undecided="the fit of after did not converge"),
        record(0.9, entry("c_1", truth, 0.5, 0.01, False), undecided="the campaigns contradict each other"),
        {**record(1.0), "failed": "why"},
    ]
    assert [holds(e) for r in records for e in r["entries"]] == [True] * 3 + [False] + [True] * 2 + [False] * 3
    text = tables(records)
    assert "| 7 | 1 of 4 | 1 of 4 | 1 of 3 | 5 of 7 (71 %) |" in text
    assert "Left undecided: 2 of 6 pairs, 1 of them because a fit did not converge" in text
    assert "did not agree: 1 pairs" in text
    assert "Not fitted: 1." in text
