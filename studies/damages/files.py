"""Damages of any file: its bytes, its place in the folder, and what stands in its place."""

from __future__ import annotations

import io
import os
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np

#: Does something to a file of a result folder and says what.
Damage = Callable[[Path, np.random.Generator], str]
#: Larger than the memory that reading may take [bytes]; the disk holds no block of it.
_HUGE_BYTES = 3_000_000_000


def bits_flipped(path: Path, rng: np.random.Generator) -> str:
    """Up to 16 bits anywhere."""
    data = bytearray(path.read_bytes())
    if not data:
        return lengthened(path, rng)
    count = int(rng.integers(1, 17))
    for at in rng.integers(0, len(data), count):
        data[at] ^= 1 << int(rng.integers(8))
    _put(path, bytes(data))
    return f"{count} bits"


def cut_off(path: Path, rng: np.random.Generator) -> str:
    """The end is missing."""
    data = path.read_bytes()
    if not data:
        return lengthened(path, rng)
    kept = int(rng.integers(0, len(data)))
    _put(path, data[:kept])
    return f"{kept} of {len(data)} bytes left"


def emptied(path: Path, rng: np.random.Generator) -> str:
    """No content."""
    _put(path, b"")
    return "empty"


def deleted(path: Path, rng: np.random.Generator) -> str:
    """No file."""
    path.unlink()
    return "deleted"


def lengthened(path: Path, rng: np.random.Generator) -> str:
    """Bytes behind the end."""
    count = int(rng.integers(1, 4096))
    _put(path, path.read_bytes() + rng.bytes(count))
    return f"{count} bytes more"


def foreign(path: Path, rng: np.random.Generator) -> str:
    """Content of another kind."""
    kinds = {
        "noise": rng.bytes(int(rng.integers(1, 20_000))),
        "zeros": bytes(int(rng.integers(1, 20_000))),
        "text": "Grüße aus der Werkstatt\n".encode("utf-16") * 50,
        "html": b"<html><script>alert(1)</script></html>",
        "pickled objects": _pickled(),
        "deep JSON": b"[" * 200_000,
        "deep JSON, closed": b'{"fit":' * 5_000 + b"1" + b"}" * 5_000,
        "JSON list": b"[1, 2, 3]",
        "JSON null": b"null",
        "huge number": b'{"fit": ' + b"9" * 20_000 + b"}",
        "NaN": b'{"fit": NaN, "sample": Infinity}',
    }
    name = str(rng.choice(list(kinds)))
    _put(path, kinds[name])
    return name


def exchanged(path: Path, rng: np.random.Generator) -> str:
    """Content of another file of the same folder."""
    others = sorted(p for p in path.parent.iterdir() if p.is_file() and p != path and not p.name.startswith("."))
    if not others:
        return cut_off(path, rng)
    other = others[int(rng.integers(len(others)))]
    mine, its = path.read_bytes(), other.read_bytes()
    _put(path, its)
    if rng.random() < 0.5:
        _put(other, mine)
        return f"exchanged with {other.name}"
    return f"overwritten by {other.name}"


def special(path: Path, rng: np.random.Generator) -> str:
    """Something that is no plain file, or one that no memory holds."""
    kinds: dict[str, Callable[[], object]] = {
        "pipe": lambda: os.mkfifo(path),
        "folder": path.mkdir,
        "folder with content": lambda: (path / "inner").mkdir(parents=True),
        "link to nothing": lambda: path.symlink_to("nowhere"),
        "link to itself": lambda: path.symlink_to(path.name),
        "link to an endless device": lambda: path.symlink_to("/dev/zero"),
        "socket": lambda: _socket(path),
        "huge file": lambda: _huge(path),
    }
    name = str(rng.choice(list(kinds)))
    path.unlink()
    kinds[name]()
    return name


FILE_DAMAGES: dict[str, tuple[float, Damage]] = {
    "bits flipped": (4.0, bits_flipped),
    "cut off": (3.0, cut_off),
    "emptied": (1.0, emptied),
    "deleted": (1.0, deleted),
    "lengthened": (1.0, lengthened),
    "foreign content": (3.0, foreign),
    "exchanged": (2.0, exchanged),
    "no plain file": (3.0, special),
}


def _put(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _pickled() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, fields=np.array([{"a": 1}, print], dtype=object))
    return buffer.getvalue()


def _socket(path: Path) -> None:
    # The name of a socket is short.
    before = os.open(".", os.O_RDONLY)
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.fchdir(before)
        os.close(before)


def _huge(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(_HUGE_BYTES)
