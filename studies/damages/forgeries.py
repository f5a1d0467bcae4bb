"""Forged stage and chain files: other content under a checksum that is right, as only a person makes them."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from studies.damages.files import Damage
from sysid import array_file

#: What stands where another type is expected.
_LEAVES: tuple[Any, ...] = (
    None, True, -1, 0, 10**18, 1e308, float("nan"), float("inf"), "", "x" * 500, "<b>&</b>", "\x1b[31m", [], {}, [[]],
    {"array": "array_0"}, {"array": "nothing"}, {"items": []}, {"class": "Path", "members": {}},
)  # fmt: skip


def leaf_changed(path: Path, rng: np.random.Generator) -> str:
    """One value anywhere in the fields has another type or value."""
    content = _read(path)
    places = list(_places(content.fields))
    holder, key = places[int(rng.integers(len(places)))]
    new = _LEAVES[int(rng.integers(len(_LEAVES)))]
    holder[key] = new
    array_file.write(path, content.fields, content.arrays)
    return f"{key}: {str(new)[:40]!r}"


def number_changed(path: Path, rng: np.random.Generator) -> str:
    """One number is another one of its type."""
    content = _read(path)
    places = [(h, k) for h, k in _places(content.fields) if type(h[k]) in (int, float)]
    if not places:
        return array_changed(path, rng)
    holder, key = places[int(rng.integers(len(places)))]
    new = (-1, 0, 7, 10**9, 10**18)[int(rng.integers(5))]
    holder[key] = type(holder[key])(new)
    array_file.write(path, content.fields, content.arrays)
    return f"{key}: {new}"


def member_changed(path: Path, rng: np.random.Generator) -> str:
    """A member is missing, has another name, or is repeated."""
    content = _read(path)
    places = [(h, k) for h, k in _places(content.fields) if isinstance(h[k], dict | list) and h[k]]
    holder, key = places[int(rng.integers(len(places)))]
    found = holder[key]
    kind = str(rng.choice(["missing", "renamed", "repeated", "reversed"]))
    if isinstance(found, list):
        at = int(rng.integers(len(found)))
        new = {"missing": found[:at] + found[at + 1 :], "repeated": found * 3, "reversed": found[::-1]}
        holder[key] = new.get(kind, [])
    else:
        name = list(found)[int(rng.integers(len(found)))]
        value = found.pop(name)
        if kind != "missing":
            found[f"{name}_"] = value
    array_file.write(path, content.fields, content.arrays)
    return f"{key}: {kind}"


def array_changed(path: Path, rng: np.random.Generator) -> str:
    """One array has another type, shape or content."""
    content = _read(path)
    if not content.arrays:
        return leaf_changed(path, rng)
    name = list(content.arrays)[int(rng.integers(len(content.arrays)))]
    array = content.arrays[name]
    kinds: dict[str, Any] = {
        "texts": lambda: array.astype(str),
        "integers": lambda: np.nan_to_num(array).astype(np.int8),
        "complex": lambda: array.astype(complex),
        "booleans": lambda: array.astype(bool),
        "half": lambda: array[: len(array) // 2] if array.ndim else array,
        "twice": lambda: np.concatenate([array, array]) if array.ndim else array,
        "transposed": lambda: array.T,
        "flat": lambda: array.ravel(),
        "deeper": lambda: array[None],
        "nothing": lambda: array[:0] if array.ndim else np.zeros(0),
        "one number": lambda: np.float64(1.0),
        "not a number": lambda: np.full(array.shape, np.nan),
        "infinite": lambda: np.full(array.shape, np.inf),
        "negative": lambda: -np.ones(array.shape),
        "huge": lambda: np.full(array.shape, 1e300),
        "zero": lambda: np.zeros(array.shape),
    }
    kind = str(rng.choice(list(kinds)))
    content.arrays[name] = np.asarray(kinds[kind]())
    array_file.write(path, content.fields, content.arrays)
    return f"{name} {array.shape}: {kind}"


def arrays_exchanged(path: Path, rng: np.random.Generator) -> str:
    """Two arrays have changed their names."""
    content = _read(path)
    names = list(content.arrays)
    if len(names) < 2:
        return array_changed(path, rng)
    a, b = (names[i] for i in rng.choice(len(names), 2, replace=False))
    content.arrays[a], content.arrays[b] = content.arrays[b], content.arrays[a]
    array_file.write(path, content.fields, content.arrays)
    return f"{a} and {b}"


def deep(path: Path, rng: np.random.Generator) -> str:
    """Lists in lists where the result stands."""
    content = _read(path)
    depth = int(rng.choice([200, 900, 20_000, 500_000]))
    marked = json.dumps({**content.fields, "result": 0})
    _archive(path, marked.replace('"result": 0', f'"result": {"[" * depth}{"]" * depth}'), zipfile.ZIP_STORED)
    return f"{depth} levels"


def bomb(path: Path, rng: np.random.Generator) -> str:
    """Compressed entries, or array headers that promise more than there is."""
    content = _read(path)
    if rng.random() < 0.5:
        _archive(path, json.dumps(content.fields) + " " * 300_000_000, zipfile.ZIP_DEFLATED)
        return "300 MB in few bytes"
    header = io.BytesIO()
    shape = (10**12,) if rng.random() < 0.5 else (2**62, 4)
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    _archive(path, json.dumps(content.fields), zipfile.ZIP_STORED, header.getvalue())
    return f"an array of shape {shape}"


FORGERIES: dict[str, tuple[float, Damage]] = {
    "forged: another type": (3.0, leaf_changed),
    "forged: another number": (1.0, number_changed),
    "forged: members": (2.0, member_changed),
    "forged: an array": (3.0, array_changed),
    "forged: arrays exchanged": (1.0, arrays_exchanged),
    "forged: deep JSON": (0.5, deep),
    "forged: sizes": (0.5, bomb),
}


def _read(path: Path) -> array_file.Content:
    content = array_file.read(path)
    assert content is not None
    return content


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every value below a tree of JSON as the list or table that holds it and its place there."""
    pairs = list(tree.items()) if isinstance(tree, dict) else list(enumerate(tree)) if isinstance(tree, list) else []
    for key, value in pairs:
        # Another fingerprint is another campaign: the file is left alone without a look.
        if key != "fingerprint":
            yield tree, key
            yield from _places(value)


def _archive(path: Path, fields: str, method: int, array: bytes = b"") -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("fields.json", fields)
        if array:
            archive.writestr("array_0.npy", array)
        archive.comment = b"0" * 64
    content = buffer.getvalue()[:-64]
    path.write_bytes(content + hashlib.sha256(content).hexdigest().encode())
