"""Replicates of a study, one small file each: a study that was stopped goes on with those that are missing."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

Record = dict[str, Any]


def shard(folder: Path, study: str, number: int) -> Path:
    """File of one replicate."""
    return folder / f"{study}_{number:04d}.json"


def fill(folder: Path, study: str, numbers: range, replicate: Callable[[int], Record]) -> Iterator[int]:
    """Compute the replicates that have no file yet; yields the number of each that was written."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        path = shard(folder, study, number)
        if path.exists():
            continue
        temporary = path.with_suffix(".tmp")
        temporary.write_text(json.dumps(replicate(number)), encoding="utf-8")
        os.replace(temporary, path)
        yield number


def collect(folder: Path, study: str) -> list[Record]:
    """All replicates of a study that are there, by number."""
    return [json.loads(p.read_text(encoding="utf-8")) for p in sorted(folder.glob(f"{study}_[0-9]*.json"))]
