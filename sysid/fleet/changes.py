"""Whether the results of a campaign are still those of its files, and the ones that were computed: by hashes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.export.identity import content_sha256
from sysid.files import json_table, read_bytes
from sysid.fleet.draws import RECORD_FILE, record_digest
from sysid.fleet.key import calibration_key, file_digests, folder_state
from sysid.fleet.outcome import RESULT_FILE, Outcome
from sysid.numbers import listing
from sysid.wording import shorten


@dataclass(frozen=True)
class Changes:
    """Input files that are not as they were, those that cannot be read, and whether results or draws are others."""

    inputs: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    result: bool = False
    draws: bool = False

    @property
    def sentence(self) -> str:
        """Why the numbers do not count; empty if they do.  Inputs that are missing may be kept elsewhere."""
        if self.result:
            return f"its {RESULT_FILE} is missing or not the one that was computed"
        if self.draws:
            return f"its {RECORD_FILE} is missing or not the one that was computed"
        if self.inputs:
            return f"it has changed since it was calibrated ({listing([shorten(name) for name in self.inputs])})"
        return ""


def changes(outcome: Outcome, campaign: Path, output: Path) -> Changes:
    """What has changed since a campaign has been calibrated; all of its input files are hashed."""
    if not outcome.finished:
        return Changes()
    now = file_digests(campaign, outcome.inputs)
    return Changes(
        tuple(name for name, digest in outcome.inputs.items() if now[name] not in ("", digest)),
        tuple(name for name in outcome.inputs if not now[name]),
        not is_result(outcome, output),
        not has_draws(outcome, output),
    )


def is_result(outcome: Outcome, output: Path) -> bool:
    """Whether the ``result.json`` in a folder is the one that was computed, apart from its times."""
    return is_content(outcome, read_bytes(output / RESULT_FILE) or b"")


def is_content(outcome: Outcome, content: bytes) -> bool:
    """Whether the content of a ``result.json`` is the one that was computed, apart from its times."""
    if hashlib.sha256(content).hexdigest() == outcome.file_sha256:
        return True
    document = json_table(content)
    try:
        return "timings" in document and content_sha256(document) == outcome.result_sha256
    except RecursionError:
        return False


def has_draws(outcome: Outcome, output: Path) -> bool:
    """Whether the draws for the fleet in a folder are those that were made; outcomes of earlier versions do not say."""
    return not outcome.draws_sha256 or record_digest(output) == outcome.draws_sha256


def still_valid(outcome: Outcome, campaign: Path, output: Path, choices: Mapping[str, Any]) -> bool:
    """Whether an outcome is that of the campaign as it is now: inputs, options, program, and the result on disk."""
    now: Mapping[str, str]
    now = file_digests(campaign, outcome.inputs) if outcome.finished else folder_state(campaign)
    if calibration_key(now, choices) != outcome.key:
        return False
    return not outcome.finished or (is_result(outcome, output) and has_draws(outcome, output))
