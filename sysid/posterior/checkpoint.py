"""Checkpoints of a sampling run: a chain that was stopped at any moment goes on as if it had never stopped."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from sysid.errors import CampaignError
from sysid.folder_lock import FolderLock, cannot_write
from sysid.posterior.chain_files import (
    DRAWS,
    PREVIOUS,
    STATE,
    Ending,
    Segment,
    State,
    StoredDraws,
    Tail,
    append_segment,
    read_draws,
    read_state,
    write_state,
    write_whole,
)

IDENTITY = "identity.json"
_SAFE = "; everything up to the last checkpoint is safe and --resume goes on from there"


@dataclass(frozen=True)
class Resumed:
    """What a run starts with: segments so far, where they end (None: nowhere yet), what the user should know."""

    segments: list[Segment]
    ending: Ending | None
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
        self._tail = Tail(0, 0, _start(self._identity))
        self._lock = FolderLock(folder)

    def __enter__(self) -> Checkpoint:
        self._lock.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.__exit__(kind, error, trace)

    def open(self, *, resume: bool) -> Resumed:
        """What to continue from; an earlier run of other data or settings is refused, or removed if not resuming.

        Raises
        ------
        CampaignError
            If `resume` is asked for and the stored run has other data or settings, naming what changed.
        OutputError
            If the folder cannot be written.
        """
        try:
            if resume and any((self._folder / name).exists() for name in (IDENTITY, STATE, PREVIOUS)):
                self._compare(_read_identity(self._folder))
                self._write_identity()
                return self._recover()
            # The states go first: draws without a state are still a chain, a state without draws is damage.
            for name in (STATE, PREVIOUS, DRAWS):
                (self._folder / name).unlink(missing_ok=True)
            self._write_identity()
        except OSError as error:
            raise cannot_write(self._folder, error) from error
        return Resumed([], None, "")

    def append(self, segment: Segment) -> None:
        """Keep the next segment."""
        try:
            tail = append_segment(self._folder, self._tail, segment)
            write_state(self._folder, State(self._identity, tail, segment.ending))
        except OSError as error:
            raise cannot_write(self._folder, error, _SAFE) from error
        self._tail = tail

    def _write_identity(self) -> None:
        write_whole(self._folder / IDENTITY, json.dumps(self._identity, indent=1).encode())

    def _compare(self, stored: dict[str, str] | None) -> None:
        if stored is None:
            raise CampaignError(
                f"{self._folder.name}/{IDENTITY} is damaged, so it cannot be told whether the chain there belongs "
                "to these inputs; start afresh without --resume, or choose another --output."
            )
        keys = sorted(set(stored) | set(self._identity))
        changed = [k for k in keys if stored.get(k) != self._identity.get(k)]
        if changed:
            raise CampaignError(
                f"The chain in {self._folder.name}/ belongs to other inputs: {', '.join(changed)} changed since; "
                "start afresh without --resume, or choose another --output."
            )

    def _recover(self) -> Resumed:
        """The newest state whose draws are all intact; without one, the end of the last intact segment."""
        draws = read_draws(self._folder, self._tail.digest)
        current, previous = (read_state(self._folder / name) for name in (STATE, PREVIOUS))
        note = self._damage(current, previous, draws)
        chosen = next((s for s in (current, previous) if s is not None and _commits(s, draws)), None)
        if chosen is None and draws.segments:
            chosen = State(self._identity, draws.tails[-1], draws.segments[-1].ending)
        if chosen is not None:
            self._tail = chosen.tail
        self._clear_away(keep_states=chosen is not None and chosen is current)
        if chosen is None:
            return Resumed([], None, note)
        if chosen is not current:
            write_state(self._folder, chosen)
        return Resumed(draws.segments[: self._tail.segments], chosen.ending, note)

    def _clear_away(self, *, keep_states: bool) -> None:
        """Remove what lies behind the tail, and states that are not the one in use."""
        path = self._folder / DRAWS
        if path.exists() and path.stat().st_size > self._tail.size:
            os.truncate(path, self._tail.size)
        if not keep_states:
            for name in (PREVIOUS, STATE):
                (self._folder / name).unlink(missing_ok=True)

    def _damage(self, current: State | None, previous: State | None, draws: StoredDraws) -> str:
        """What was found damaged and what is used instead; empty where a kill explains what is there."""
        name, intact = self._folder.name, len(draws.segments)
        again = "what is missing is drawn again and the chain is the same"
        if current is None and (self._folder / STATE).exists():
            return f"{name}/{STATE} is damaged: the checkpoint before it is used; {again}."
        newest = current or previous
        if newest is not None and not _commits(newest, draws):
            return f"{name}/{DRAWS} is damaged behind segment {intact}: the checkpoint there is used; {again}."
        return ""


def read_chain(folder: Path) -> tuple[dict[str, str], list[Segment]] | None:
    """Identity and committed segments of a chain, also while it is written; None if there is none.

    A damaged file shortens the chain to what is intact.
    """
    try:
        identity = _read_identity(folder)
        if identity is None:
            return None
        states = [read_state(folder / name) for name in (STATE, PREVIOUS)]
        draws = read_draws(folder, _start(identity))
    except OSError:
        return None
    committed = [s.tail.segments for s in states if s is not None and _commits(s, draws)]
    segments = draws.segments[: committed[0]] if committed else draws.segments
    return (identity, segments) if segments else None


def _commits(state: State, draws: StoredDraws) -> bool:
    """Whether the segments that a state counts are there, unharmed and its own."""
    count = state.tail.segments
    return 0 < count <= len(draws.tails) and draws.tails[count - 1] == state.tail


def _start(identity: dict[str, str]) -> str:
    """What the first segment names as the one before it: no other run can own it."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


def _read_identity(folder: Path) -> dict[str, str] | None:
    """Identity of the chain in a folder: a state's copy, which has a checksum, else the file of its own."""
    for name in (STATE, PREVIOUS):
        state = read_state(folder / name)
        if state is not None:
            return state.identity
    try:
        return dict(json.loads((folder / IDENTITY).read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError, TypeError):
        return None
