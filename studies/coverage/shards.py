"""Replicates of a study, one small file each: a study that was stopped goes on with those that are missing.

A replicate is marked with a hash of the sources behind it: those of other code are computed again, and left out.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

Record = dict[str, Any]

_ROOT = Path(__file__).resolve().parents[2]
_MARK = "sources"
#: What only writes about replicates.
_WRITERS = (
    "studies/cases.py",
    "studies/changes/__main__.py",
    "studies/changes/table.py",
    "studies/coverage/__main__.py",
    "studies/coverage/tables.py",
    "studies/factors/__main__.py",
    "studies/factors/table.py",
    "studies/independent/__main__.py",
    "studies/independent/table.py",
    "studies/made_trucks/__main__.py",
    "studies/made_trucks/table.py",
    "studies/road_drives/pairs_table.py",
)
#: Begin of the names of modules of `tests/support` that studies simulate with.
_SIMULATING = "independent_"
#: Packages that results of a study rest on.
_PACKAGES = (
    "balance",
    "campaign",
    "road",
    "sdof",
    "bookkeeping",
    "vehicle_model",
    "estimation",
    "posterior",
    "prediction",
    "selftest",
    "comparison",
)


class Shards(NamedTuple):
    """Replicates by number, and how many files there are of other code."""

    records: list[Record]
    foreign: int


@lru_cache(maxsize=1)
def sources(root: Path = _ROOT) -> str:
    """Hash of the sources of the studies and of what they rest on in `sysid`; what only shows results is left out."""
    found = hashlib.sha256()
    for folder in (*(f"sysid/{name}" for name in _PACKAGES), "studies", "tests/support"):
        for path in sorted(p for p in (root / folder).rglob("*") if p.suffix in (".py", ".cpp", ".h")):
            if folder == "tests/support" and not path.name.startswith(_SIMULATING):
                continue
            name = path.relative_to(root).as_posix()
            if name not in _WRITERS:
                found.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


def shard(folder: Path, study: str, number: int) -> Path:
    """File of one replicate."""
    return folder / f"{study}_{number:04d}.json"


def fill(folder: Path, study: str, numbers: range, replicate: Callable[[int], Record]) -> Iterator[int]:
    """Compute the replicates that have no file of these sources yet; yields the number of each that was written."""
    folder.mkdir(parents=True, exist_ok=True)
    # Taken before the first replicate: the files may change while a study runs.
    mark = sources()
    for number in numbers:
        path = shard(folder, study, number)
        if path.exists() and _read(path).get(_MARK) == mark:
            continue
        # Several processes may fill one folder.
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(json.dumps({**replicate(number), _MARK: mark}), encoding="utf-8")
        os.replace(temporary, path)
        yield number


def collect(folder: Path, study: str) -> Shards:
    """All replicates of a study by these sources, by number."""
    every = [_read(p) for p in sorted(folder.glob(f"{study}_[0-9]*.json"))]
    own = [r for r in every if r.get(_MARK) == sources()]
    return Shards(own, len(every) - len(own))


def _read(path: Path) -> Record:
    return dict(json.loads(path.read_text(encoding="utf-8")))
