"""The files of a chain: draws in an append-only file of checksummed segments, and a small state that commits them.

    draws.bin            one frame per segment: draws, log-densities, counts, and the random state at its end; every
                         segment names the digest of the one before it
    state.bin            positions and random state to go on from, and how much of draws.bin belongs to them
    state.previous.bin   the state before

A segment is on the disk before the state that counts it, and a state replaces the one before in a single step. So a
process can die at any moment, and a reader needs no lock: bytes behind the committed length are not there for it.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sysid.posterior import frames

DRAWS, STATE, PREVIOUS = "draws.bin", "state.bin", "state.previous.bin"
#: Pauses [s] before a file that a reader holds open is replaced again: only Windows refuses that.
_PAUSES_S = (0.01, 0.1, 1.0)


@dataclass(frozen=True)
class Ending:
    """Where the ensembles are: what a chain needs to go on.

    `positions` (E, W, p), `log_probability` (E, W); `random_keys` (E, 624) and `random_places` (E, 3) are the state of
    each ensemble's random numbers (place, whether a normal deviate is kept, and that deviate).
    """

    positions: np.ndarray
    log_probability: np.ndarray
    random_keys: np.ndarray
    random_places: np.ndarray


@dataclass(frozen=True)
class Segment:
    """A stretch of steps: `draws` (E, steps, W, p), `log_probability` (E, steps, W), and its ending.

    `accepted` (E, W) counts accepted proposals, `rejected` (E,) proposals without a finite density.
    """

    draws: np.ndarray
    log_probability: np.ndarray
    accepted: np.ndarray
    rejected: np.ndarray
    random_keys: np.ndarray
    random_places: np.ndarray

    @property
    def ending(self) -> Ending:
        """The state that the segment ends in."""
        return Ending(self.draws[:, -1], self.log_probability[:, -1], self.random_keys, self.random_places)


@dataclass(frozen=True)
class Tail:
    """End of the draws on disk: number of segments, bytes, and digest of the last segment."""

    segments: int
    size: int
    digest: str


@dataclass(frozen=True)
class State:
    """What a state file holds: the identity of the run, the committed draws, and where the ensembles are."""

    identity: dict[str, str]
    tail: Tail
    ending: Ending


@dataclass(frozen=True)
class StoredDraws:
    """Intact segments of a draws file; `tails[n]` is where segment n ends."""

    segments: list[Segment] = field(default_factory=list)
    tails: list[Tail] = field(default_factory=list)


def append_segment(folder: Path, tail: Tail, segment: Segment) -> Tail:
    """Write a segment behind `tail`, over whatever a killed process left there, and wait until it is on the disk."""
    frame = frames.pack({"before": tail.digest}, vars(segment))
    path = folder / DRAWS
    with path.open("r+b" if path.exists() else "wb") as handle:
        handle.seek(tail.size)
        handle.truncate()
        handle.write(frame)
        handle.flush()
        os.fsync(handle.fileno())
    return Tail(tail.segments + 1, tail.size + len(frame), frames.digest_of(frame))


def write_state(folder: Path, state: State) -> None:
    """Commit the draws up to `state.tail`; the state before is kept beside it."""
    fields = {"identity": state.identity, "tail": [state.tail.segments, state.tail.size, state.tail.digest]}
    current = folder / STATE
    temporary = write_temporary(current, frames.pack(fields, vars(state.ending)))
    if current.exists():
        _replace(current, folder / PREVIOUS)
    _replace(temporary, current)
    _flush_names(folder)


def read_state(path: Path) -> State | None:
    """A state file; None where there is none or it is damaged. Raises OSError if the file cannot be read."""
    try:
        with path.open("rb") as handle:
            frame = frames.read(handle)
        if frame is None:
            return None
        segments, size, digest = frame.fields["tail"]
        return State(dict(frame.fields["identity"]), Tail(int(segments), int(size), digest), Ending(**frame.arrays))
    except (FileNotFoundError, frames.DamagedFrameError, KeyError, TypeError, ValueError):
        return None


def read_draws(folder: Path, start: str) -> StoredDraws:
    """Intact segments from the beginning, each naming the one before; the first names `start`."""
    found, before = StoredDraws(), start
    try:
        with (folder / DRAWS).open("rb") as handle:
            for frame in frames.read_all(handle):
                if frame.fields.get("before") != before:
                    break
                found.segments.append(Segment(**frame.arrays))
                before = frame.digest
                found.tails.append(Tail(len(found.segments), frame.end, before))
    except (FileNotFoundError, TypeError):
        pass
    return found


def write_temporary(path: Path, content: bytes) -> Path:
    """Write `content` beside `path` and wait until it is on the disk; the name that it has there."""
    temporary = path.with_suffix(".tmp")
    with temporary.open("wb") as handle:
        handle.write(content)
        handle.flush()
        os.fsync(handle.fileno())
    return temporary


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file by another content in a single step."""
    _replace(write_temporary(path, content), path)
    _flush_names(path.parent)


def _replace(source: Path, target: Path) -> None:
    for pause in _PAUSES_S:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if os.name != "nt":
                raise
            time.sleep(pause)
    os.replace(source, target)


def _flush_names(folder: Path) -> None:
    """Names are on the disk too where the system can say so."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
