"""Named arrays and plain fields in one checksummed file, which is read as it was written or not at all.

The file is a ZIP archive that ``numpy.load`` opens: ``fields.json`` and one ``NAME.npy`` per array, none compressed,
and as the archive's comment the SHA-256 of all bytes before the comment.  Nothing in it is executed to read it (no
pickle), and as nothing is compressed nothing takes more memory than the file is long.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid import limits
from sysid.files import read_bytes, write_bytes

_FIELDS = "fields.json"
#: Characters of a SHA-256 in hexadecimal.
_DIGEST = 64
#: Kinds of numbers and texts; objects are never read.
_KINDS = "biufcSU"


@dataclass(frozen=True)
class Content:
    """What a file holds; `digest` is its SHA-256."""

    fields: dict[str, Any]
    arrays: dict[str, np.ndarray]
    digest: str


def write(
    path: Path,
    fields: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    before_change: Callable[[], None] = lambda: None,
) -> str:
    """Write JSON-ready fields and arrays, complete or not at all, and return the digest that a reader finds.

    `before_change` is called first where the file does not hold exactly this yet; where it does, nothing happens.
    Raises OSError if the folder cannot be written, ValueError if the file would be longer than what is read back.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        # Entries without a time: the same content gives the same bytes.
        archive.writestr(zipfile.ZipInfo(_FIELDS), json.dumps(fields))
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asarray(array, order="C"), (1, 0), allow_pickle=False)
        archive.comment = b"0" * _DIGEST
    content = buffer.getvalue()[:-_DIGEST]
    if len(content) + _DIGEST > limits.STAGE_BYTES:
        raise ValueError(
            f"it takes {len(content) / 1e9:.1f} GB, more than the {limits.STAGE_BYTES / 1e9:g} GB of a file"
        )
    digest = hashlib.sha256(content).hexdigest()
    content += digest.encode()
    if read_bytes(path, len(content)) != content:
        before_change()
        write_bytes(path, content)
    return digest


def digest_of(path: Path) -> str | None:
    """The digest of a file's content; None where there is no file, or it is damaged."""
    content = read_bytes(path, limits.STAGE_BYTES)
    return None if content is None else _digest_in(content)


def _digest_in(content: bytes) -> str | None:
    if len(content) <= _DIGEST:
        return None
    digest = hashlib.sha256(memoryview(content)[:-_DIGEST]).hexdigest()
    return digest if content[-_DIGEST:] == digest.encode() else None


def read(path: Path) -> Content | None:
    """What :func:`write` left in a file; None where there is none, it is damaged, or it is no such file."""
    content = read_bytes(path, limits.STAGE_BYTES)
    digest = None if content is None else _digest_in(content)
    if content is None or digest is None:
        return None
    try:
        fields, arrays = _unpacked(content)
    except Exception:
        # The checksum is right but another program made the file: its parts may be wrong in any way.
        return None
    return Content(fields, arrays, digest)


def _unpacked(content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
        # What is stored cannot be longer than the file: an entry is read only under the name that stands before it.
        if any(e.compress_type != zipfile.ZIP_STORED for e in entries.values()):
            raise ValueError("compressed")
        fields = json.loads(archive.read(entries.pop(_FIELDS)))
        if not isinstance(fields, dict):
            raise ValueError("no fields")
        return fields, {name.removesuffix(".npy"): _array(archive.read(e)) for name, e in entries.items()}


def _array(raw: bytes) -> np.ndarray:
    stream = io.BytesIO(raw)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("another version")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    count = math.prod(shape)
    if fortran or dtype.kind not in _KINDS or count * dtype.itemsize != len(raw) - stream.tell():
        raise ValueError("not as long as its header says")
    return np.frombuffer(raw, dtype, count, stream.tell()).reshape(shape).copy()
