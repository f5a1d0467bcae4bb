"""Readings of single drops that outlive the stage: a drop that is added costs no further reading of the others.

A reading is kept under the hash of all that it follows from: the readings of the sensors as screened, the vehicle, the
load case and the settings. The file is marked with the code behind it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from sysid.files import remove
from sysid.sdof.drop_results import DropAnalysis
from sysid.sdof.summary import OfDrop, analysed
from sysid.workflow import store
from sysid.workflow.schema import schema_digest
from sysid.workflow.sources import code_digest
from sysid.workflow.versions import versions

_HINT = dict[str, DropAnalysis]


def _file(folder: Path) -> Path:
    return folder / "stages" / "drop_readings.npz"


def kept_readings(folder: Path) -> Callable[[Sequence[OfDrop], Callable[[float], None]], tuple[DropAnalysis, ...]]:
    """As :func:`sysid.sdof.summary.analysed`, with what an output folder holds, and kept there for the next time."""

    def read(drops: Sequence[OfDrop], done: Callable[[float], None]) -> tuple[DropAnalysis, ...]:
        behind = (versions()["sysid"], code_digest(("sdof",)), schema_digest(_HINT))
        fingerprint = hashlib.sha256(json.dumps(behind).encode()).hexdigest()
        before: dict[str, DropAnalysis] = store.load(_file(folder), fingerprint, _HINT) or {}
        keys = [store.digest_of(drop) for drop in drops]
        fresh = {key: drop for key, drop in zip(keys, drops, strict=True) if key not in before}
        known = before | dict(zip(fresh, analysed(tuple(fresh.values()), done), strict=True))
        if fresh:
            # Without it they are read once more.
            with suppress(OSError, TypeError):
                store.save(_file(folder), {key: known[key] for key in keys}, fingerprint, _HINT)
        return tuple(known[key] for key in keys)

    return read


def forget_readings(folder: Path) -> None:
    """Delete what is kept in an output folder."""
    remove(_file(folder))
