"""What became of one campaign: kept beside its results, so that nothing finished is computed twice."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from sysid.files import read_json, write_text

#: ``failed``: the program or the disk, not the data; ``crashed``: its process was killed or died, twice.
State = Literal["done", "not converged", "rejected", "failed", "crashed"]
#: Those whose results can be used.
FINISHED: tuple[State, ...] = ("done", "not converged")

OUTCOME_FILE = "fleet_outcome.json"
LOG_FILE = "fleet.log"
RESULT_FILE = "result.json"
#: Version of a stored outcome; others are not read.
SCHEMA = 1
#: What outcomes of earlier versions do not have.
_LATER = ("file_sha256", "draws_sha256")


@dataclass(frozen=True)
class Outcome:
    """How a calibration ended.

    `sentence` says why it has no result; `status` is that of ``result.json``.  `key` ties it to its inputs (`inputs`,
    SHA-256 by file name; for those that could not be read what :func:`sysid.fleet.key.folder_state` says).
    `result_sha256` is that of ``result.json`` without times, `file_sha256` that of the file, `draws_sha256` that of the
    draws for the fleet; the last two are empty in outcomes of earlier versions.  `seconds` on the clock,
    `processor_seconds`, `peak_bytes` of its process, `attempts` how often it was started.
    """

    state: State
    sentence: str = ""
    status: str = ""
    key: str = ""
    inputs: Mapping[str, str] = field(default_factory=dict)
    result_sha256: str = ""
    file_sha256: str = ""
    draws_sha256: str = ""
    seconds: float = 0.0
    processor_seconds: float = 0.0
    peak_bytes: int = 0
    attempts: int = 1

    @property
    def finished(self) -> bool:
        """Whether there are results."""
        return self.state in FINISHED


def write_outcome(folder: Path, outcome: Outcome) -> None:
    """Write the outcome beside the results of its campaign; OSError where that is not possible."""
    write_text(folder / OUTCOME_FILE, json.dumps({"schema": SCHEMA, **asdict(outcome)}, indent=1) + "\n")


def read_outcome(folder: Path) -> Outcome | None:
    """The outcome that was written there; None if there is none or it cannot be read."""
    document = read_json(folder / OUTCOME_FILE)
    if document.get("schema") != SCHEMA or document.get("state") not in get_args(State):
        return None
    members = {f.name: document.get(f.name) for f in fields(Outcome)}
    members |= {name: document.get(name, "") for name in _LATER}
    if not all(_is_like(members[f.name], getattr(Outcome("done"), f.name)) for f in fields(Outcome)):
        return None
    return Outcome(**members)  # type: ignore[arg-type]


def _is_like(value: Any, example: Any) -> bool:
    """Whether a value has the type of an example: texts in tables, numbers that are none of true and false."""
    if isinstance(example, dict):
        return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())
    if isinstance(example, float):
        return type(value) in (int, float) and math.isfinite(value) and abs(value) < 2**53
    return type(value) is type(example) and (not isinstance(value, int) or 0 <= value < 2**63)
