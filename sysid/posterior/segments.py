"""Stretches of a chain on disk: one file each, complete or absent, and each naming the one before it.

    segment-000000.npz, segment-000001.npz, ...   draws, log-densities, counts, and the random state at the end

A file is on the disk before the chain goes on (:func:`sysid.files.write_bytes`), so a process can die at any
moment and leaves whole segments only; a reader needs no lock.  Every file has a checksum (:mod:`sysid.array_file`),
says which run it belongs to, and holds the digest of the segment before it.  What can be read from the first file on,
without a gap, is the chain.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from sysid import array_file
from sysid.arrays import EnsemblesByWalkers, WalkerDraws


@dataclass(frozen=True)
class ChainEnd:
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

    draws: WalkerDraws
    log_probability: np.ndarray
    accepted: EnsemblesByWalkers
    rejected: np.ndarray
    random_keys: np.ndarray
    random_places: np.ndarray

    @property
    def ending(self) -> ChainEnd:
        """The state that the segment ends in."""
        return ChainEnd(self.draws[:, -1], self.log_probability[:, -1], self.random_keys, self.random_places)


@dataclass(frozen=True)
class StoredChain:
    """Content of a folder: the `identity` of the run (None if no file can be read), its segments and their digests.

    `damaged` is the name of the first file that cannot be used although it is there, empty where there is none.
    """

    identity: dict[str, str] | None
    segments: list[Segment] = field(default_factory=list)
    digests: list[str] = field(default_factory=list)
    damaged: str = ""


def segment_file(folder: Path, number: int) -> Path:
    """File of a segment, counted from 0."""
    return folder / f"segment-{number:06d}.npz"


def segment_files(folder: Path) -> list[Path]:
    """Files of all segments in order, damaged ones too."""
    return sorted(folder.glob("segment-*.npz"))


def write_segment(path: Path, identity: dict[str, str], before: str, segment: Segment) -> str:
    """Keep a segment and return its digest; `before` is that of the one before, or :func:`start` of the run.

    Raises OSError if the folder cannot be written.
    """
    return array_file.write(path, {"identity": identity, "before": before}, vars(segment))


def read_segments(folder: Path) -> StoredChain:
    """The chain in a folder as far as it is intact."""
    files = segment_files(folder)
    identity: dict[str, str] | None = None
    segments: list[Segment] = []
    digests: list[str] = []
    for number, path in enumerate(files):
        content = array_file.read(path)
        if content is None:
            continue
        written_by = _identity(content)
        if identity is None:
            identity = written_by
        follows = number == len(segments) and path == segment_file(folder, number) and written_by is not None
        before = digests[-1] if digests else start(written_by or {})
        if follows and written_by == identity and content.fields.get("before") == before and _complete(content):
            segments.append(Segment(**content.arrays))
            digests.append(content.digest)
        else:
            break
    damaged = files[len(segments)].name if len(files) > len(segments) else ""
    return StoredChain(identity, segments, digests, damaged)


def start(identity: dict[str, str]) -> str:
    """The name that the first segment gives for the one before it; no other run can have it."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


def _identity(content: array_file.Content) -> dict[str, str] | None:
    identity = content.fields.get("identity")
    return {str(k): str(v) for k, v in identity.items()} if isinstance(identity, dict) else None


def _complete(content: array_file.Content) -> bool:
    """Whether all arrays of a segment are there, numbers, and fit each other."""
    if set(content.arrays) != {f.name for f in fields(Segment)}:
        return False
    draws = content.arrays["draws"]
    return (
        draws.ndim == 4
        and all(array.dtype.kind in "fiu" for array in content.arrays.values())
        and content.arrays["log_probability"].shape == draws.shape[:3]
        and content.arrays["accepted"].shape == (draws.shape[0], draws.shape[2])
        and content.arrays["rejected"].shape == draws.shape[:1]
        and content.arrays["random_keys"].shape == (draws.shape[0], 624)
        and content.arrays["random_places"].shape == (draws.shape[0], 3)
        and draws.shape[1] > 0
    )
