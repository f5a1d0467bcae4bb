"""Checksummed frames: named arrays and plain fields in one run of bytes that is either intact or known to be damaged.

    magic (8) | payload length (8, little endian) | SHA-256 of the payload (32) | payload
    payload:  length of the description (4, little endian) | description (JSON, UTF-8) | arrays, one after the other

Nothing in a frame is executed to read it, and nothing is allocated before its length fits into the file.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

MAGIC = b"SYSIDFR1"
_HEADER = struct.Struct("<8sQ32s")
_LENGTH = struct.Struct("<I")


class DamagedFrameError(Exception):
    """Bytes that are not a frame as it was written."""


@dataclass(frozen=True)
class Frame:
    """What a frame holds; `end` is the position in the file behind it, `digest` the SHA-256 of its payload."""

    fields: dict[str, Any]
    arrays: dict[str, np.ndarray]
    digest: str
    end: int


def pack(fields: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """The frame of JSON-ready fields and numeric arrays."""
    stored = {name: np.ascontiguousarray(a, a.dtype.newbyteorder("<")) for name, a in arrays.items()}
    layout = [[name, a.dtype.str, list(a.shape)] for name, a in stored.items()]
    description = json.dumps({"fields": fields, "arrays": layout}).encode()
    payload = b"".join([_LENGTH.pack(len(description)), description, *(a.tobytes() for a in stored.values())])
    return _HEADER.pack(MAGIC, len(payload), hashlib.sha256(payload).digest()) + payload


def digest_of(frame: bytes) -> str:
    """The digest that a reader finds in the frame."""
    return _HEADER.unpack_from(frame)[2].hex()


def read(handle: BinaryIO) -> Frame | None:
    """The next frame of a file; None at its end.

    Raises
    ------
    DamagedFrameError
        If what follows is cut or not what was written.
    """
    head = handle.read(_HEADER.size)
    if not head:
        return None
    if len(head) < _HEADER.size:
        raise DamagedFrameError
    magic, length, digest = _HEADER.unpack(head)
    if magic != MAGIC or length > os.fstat(handle.fileno()).st_size - handle.tell():
        raise DamagedFrameError
    payload = handle.read(length)
    if len(payload) < length or hashlib.sha256(payload).digest() != digest:
        raise DamagedFrameError
    try:
        fields, arrays = _unpack(payload)
    except (ValueError, KeyError, TypeError, struct.error) as error:
        # An intact frame of another program: its description is not one of ours.
        raise DamagedFrameError from error
    return Frame(fields, arrays, digest.hex(), handle.tell())


def read_all(handle: BinaryIO) -> Iterator[Frame]:
    """The intact frames up to the end of the file or the first damage."""
    try:
        while (frame := read(handle)) is not None:
            yield frame
    except DamagedFrameError:
        return


def _unpack(payload: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    (size,) = _LENGTH.unpack_from(payload)
    place = _LENGTH.size + size
    description = json.loads(payload[_LENGTH.size : place])
    arrays = {}
    for name, kind, shape in description["arrays"]:
        dtype = np.dtype(kind)
        if dtype.hasobject:
            raise ValueError(name)
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(payload, dtype, count, place).reshape(shape)
        place += count * dtype.itemsize
    return dict(description["fields"]), arrays
