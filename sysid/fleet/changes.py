"""Whether the results of a campaign are still those of its files, and the ones that were computed: by hashes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sysid.errors import CampaignError
from sysid.fleet.key import file_digests, result_digest
from sysid.fleet.outcome import RESULT_FILE, Outcome
from sysid.numbers import listing
from sysid.wording import shorten


@dataclass(frozen=True)
class Changes:
    """Input files that are not as they were, those that cannot be read, and whether ``result.json`` is another."""

    inputs: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    result: bool = False

    @property
    def sentence(self) -> str:
        """Why the numbers do not count; empty if they do.  Inputs that are missing may be kept elsewhere."""
        if self.result:
            return f"its {RESULT_FILE} is missing or not the one that was computed"
        if self.inputs:
            return f"it has changed since it was calibrated ({listing([shorten(name) for name in self.inputs])})"
        return ""


def changes(outcome: Outcome, campaign: Path, output: Path) -> Changes:
    """What has changed since a campaign has been calibrated; all of its input files are hashed."""
    if not outcome.finished:
        return Changes()
    now = file_digests(campaign, outcome.inputs)
    try:
        same = result_digest(output / RESULT_FILE) == outcome.result_sha256
    except CampaignError:
        same = False
    return Changes(
        tuple(name for name, digest in outcome.inputs.items() if now[name] not in ("", digest)),
        tuple(name for name in outcome.inputs if not now[name]),
        not same,
    )
