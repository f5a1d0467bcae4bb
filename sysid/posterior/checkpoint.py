"""Checkpoints of a sampling run: one self-contained segment file per stretch of steps, written atomically.

A segment holds the draws of all ensembles and the state they ended in, random numbers included, so a run that was
stopped at any moment continues from its last complete segment as if it had never stopped.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.errors import CampaignError, DataRejectedError


@dataclass(frozen=True)
class Segment:
    """A stretch of steps: `draws` (E, steps, W, p), `log_probability` (E, steps, W), `accepted` (E, W) counts.

    `random_keys` (E, 624) and `random_positions` (E, 3) are the state of each ensemble's random numbers at the end
    (position, whether a normal deviate is kept, and that deviate).
    """

    draws: np.ndarray
    log_probability: np.ndarray
    accepted: np.ndarray
    random_keys: np.ndarray
    random_positions: np.ndarray


class Checkpoint:
    """Segments of one sampling run in a folder, tied to a fingerprint of data and settings."""

    def __init__(self, folder: Path, fingerprint: dict[str, str]):
        self._folder = folder
        self._fingerprint = dict(sorted(fingerprint.items()))

    def open(self, *, resume: bool) -> list[Segment]:
        """Segments to continue from; an earlier run of other data or settings is refused, or removed if not resuming.

        Raises
        ------
        CampaignError
            If `resume` is asked for and the stored run has other data or settings, naming what changed.
        DataRejectedError
            If the folder cannot be written.
        """
        identity = self._folder / "identity.json"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if resume and identity.exists():
                self._compare(identity.read_text(encoding="utf-8", errors="replace"))
                return self._load()
            for old in self._files():
                old.unlink()
            _atomic_bytes(identity, json.dumps(self._fingerprint, indent=1).encode())
        except OSError as error:
            raise DataRejectedError(
                f"The chain cannot be kept in {self._folder.name}/ ({error.strerror}); free some space or choose "
                "another folder with --output."
            ) from error
        return []

    def append(self, number: int, segment: Segment) -> None:
        """Write segment `number` (0, 1, ...)."""
        path = self._folder / f"segment_{number:05d}.npz"
        try:
            temporary = path.with_suffix(".tmp")
            with temporary.open("wb") as handle:
                np.savez(handle, **vars(segment))
                handle.flush()
                os.fsync(handle.fileno())
            os.replace(temporary, path)
        except OSError as error:
            raise DataRejectedError(
                f"The chain cannot be kept in {self._folder.name}/ ({error.strerror}); everything up to the last "
                "complete segment is safe: free some space and go on with --resume."
            ) from error

    def _files(self) -> list[Path]:
        return sorted(self._folder.glob("segment_*.npz"))

    def _compare(self, identity: str) -> None:
        try:
            stored = dict(json.loads(identity))
        except (ValueError, TypeError) as error:
            raise CampaignError(
                f"{self._folder.name}/identity.json is damaged, so it cannot be told whether the chain there belongs "
                "to these inputs; start afresh without --resume, or choose another --output."
            ) from error
        keys = sorted(set(stored) | set(self._fingerprint))
        changed = [k for k in keys if stored.get(k) != self._fingerprint.get(k)]
        if changed:
            raise CampaignError(
                f"The chain in {self._folder.name}/ belongs to other inputs: {', '.join(changed)} changed since; "
                "start afresh without --resume, or choose another --output."
            )

    def _load(self) -> list[Segment]:
        segments = []
        for number, path in enumerate(self._files()):
            if path.name != f"segment_{number:05d}.npz":
                break
            try:
                with path.open("rb") as handle, np.load(handle, allow_pickle=False) as data:
                    segments.append(Segment(**{name: data[name] for name in Segment.__annotations__}))
            except Exception:
                # A damaged segment ends what can be continued, whatever reading it raises (a flipped bit can ask for a
                # password, an unknown compression, or end in the tokeniser); the ones before it are complete.
                break
        for path in self._files()[len(segments) :]:
            path.unlink()
        return segments


def _atomic_bytes(path: Path, content: bytes) -> None:
    temporary = path.with_suffix(".tmp")
    with temporary.open("wb") as handle:
        handle.write(content)
        handle.flush()
        os.fsync(handle.fileno())
    os.replace(temporary, path)
