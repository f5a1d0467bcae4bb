"""Checkpoints of a sampling run: a chain that was stopped at any moment continues as if it had never stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from sysid.errors import CampaignError
from sysid.files import remove, remove_unfinished
from sysid.folder_lock import FolderLock, cannot_write
from sysid.posterior.segments import (
    ChainEnd,
    Segment,
    StoredChain,
    read_segments,
    segment_file,
    segment_files,
    start,
    write_segment,
)

_SAFE = "; everything up to the last checkpoint is safe and --resume goes on from there"


@dataclass(frozen=True)
class Resumed:
    """The start of a run: segments so far, where they end (None: no segment yet), what the user should know."""

    segments: list[Segment]
    ending: ChainEnd | None
    note: str


class Checkpoint:
    """The chain of one run in a folder, tied to a fingerprint of data and settings; entered, it is the only writer.

    Raises
    ------
    OutputError
        If another process writes to the folder, or it is full or read-only.
    """

    def __init__(self, folder: Path, fingerprint: dict[str, str]):
        self._folder = folder
        self._identity = dict(sorted(fingerprint.items()))
        self._count, self._digest = 0, start(self._identity)
        self._lock = FolderLock(folder)

    def __enter__(self) -> Checkpoint:
        self._lock.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.__exit__(kind, error, trace)

    def open(self, *, resume: bool) -> Resumed:
        """The start of a continued run; an earlier run of other data is refused, or removed if not resuming.

        Raises
        ------
        CampaignError
            If `resume` is true and the stored run has other data or settings; the message names the change.
        OutputError
            If the folder cannot be written.
        """
        stored = read_segments(self._folder) if resume else StoredChain(None)
        if stored.identity is not None:
            self._compare(stored.identity)
        try:
            remove_unfinished(self._folder)
            # The last goes first: a kill in between leaves a shorter chain, not one with a gap.
            for path in reversed(segment_files(self._folder)[len(stored.segments) :]):
                remove(path)
        except OSError as error:
            raise cannot_write(self._folder, error) from error
        if stored.segments:
            self._count, self._digest = len(stored.segments), stored.digests[-1]
        note = ""
        if stored.damaged:
            used = "the checkpoint before it is used" if self._count else "the chain begins anew"
            note = (
                f"{self._folder.name}/{stored.damaged} is damaged: {used}; what is missing is drawn again and the "
                "chain is the same."
            )
        return Resumed(stored.segments, stored.segments[-1].ending if stored.segments else None, note)

    def append(self, segment: Segment) -> None:
        """Keep the next segment."""
        path = segment_file(self._folder, self._count)
        try:
            self._digest = write_segment(path, self._identity, self._digest, segment)
        except OSError as error:
            raise cannot_write(self._folder, error, _SAFE) from error
        self._count += 1

    def _compare(self, stored: dict[str, str]) -> None:
        keys = sorted(set(stored) | set(self._identity))
        changed = [k for k in keys if stored.get(k) != self._identity.get(k)]
        if changed:
            raise CampaignError(
                f"The chain in {self._folder.name}/ belongs to other inputs: {', '.join(changed)} changed since; "
                "the command 'sample' without --resume begins a new one, or choose another --output."
            )


def read_chain(folder: Path) -> tuple[dict[str, str], list[Segment]] | None:
    """Identity and segments of a chain, also while it is written; None if there is none.

    A damaged file shortens the chain to what is before it.
    """
    stored = read_segments(folder)
    return (stored.identity, stored.segments) if stored.identity is not None and stored.segments else None
