"""Results of the stages on disk: one file per stage, frozen dataclasses in and out, no pickle.

The file is that of :mod:`sysid.array_file`; its fields hold the fingerprint and the result as nested JSON, in which
arrays stand by their name. A file is decoded by the type of the stage's result. A file with another class, another
member, a member of another type, or any damage counts as missing.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args

import numpy as np

from sysid import array_file
from sysid.workflow.schema import PLAIN, field_hints, kind_of


def save(
    path: Path, result: Any, fingerprint: str, hint: Any, before_change: Callable[[], None] = lambda: None
) -> None:
    """Write a stage result of type `hint`, complete or not at all, marked with the fingerprint of what it depends on.

    `before_change` is called first unless the file holds exactly this result already.

    Raises
    ------
    TypeError
        If the result is not of its type or too large to be read back.
    OSError
        If the folder cannot be written.
    """
    arrays: dict[str, np.ndarray] = {}
    tree = _encoded(result, arrays)
    try:
        _decoded(tree, hint, arrays)
    except (ValueError, KeyError) as error:
        raise TypeError(str(error)) from error
    try:
        array_file.write(path, {"fingerprint": fingerprint, "result": tree}, arrays, before_change)
    except ValueError as error:
        raise TypeError(str(error)) from error


def load(path: Path, fingerprint: str, hint: Any) -> Any | None:
    """Read a stage result of type `hint`; None if there is none, it is damaged, or has another fingerprint."""
    content = array_file.read(path)
    if content is None or content.fields.get("fingerprint") != fingerprint:
        return None
    try:
        return _decoded(content.fields["result"], hint, content.arrays)
    except Exception:
        # Not what was declared; a class may refuse members that do not fit each other in any way it likes.
        return None


def load_part(path: Path, members: Sequence[str], hint: Any) -> Any | None:
    """Read a member of a stored result, of whatever inputs it is; None if there is none or it is damaged.

    Parameters
    ----------
    members : names on the way to it, from the result down. hint : its type.
    """
    content = array_file.read(path)
    if content is None:
        return None
    try:
        tree = content.fields["result"]
        for name in members:
            tree = tree["members"][name]
        return _decoded(tree, hint, content.arrays)
    except Exception:
        return None


def digest_of(value: Any) -> str:
    """Hash of everything that a value holds, which is of the types that a stage result has."""
    arrays: dict[str, np.ndarray] = {}
    digest = hashlib.sha256(json.dumps(_encoded(value, arrays)).encode())
    for array in arrays.values():
        digest.update(f"{array.dtype.str}{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def fingerprint_in(path: Path) -> str | None:
    """The fingerprint that a stage's file is marked with; None if there is none or it is damaged."""
    content = array_file.read(path)
    marked = None if content is None else content.fields.get("fingerprint")
    return marked if isinstance(marked, str) else None


def _encoded(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        members = {f.name: _encoded(getattr(value, f.name), arrays) for f in dataclasses.fields(value)}
        return {"class": type(value).__name__, "members": members}
    if isinstance(value, np.ndarray):
        name = f"array_{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple | list):
        return [_encoded(v, arrays) for v in value]
    if isinstance(value, Mapping):
        return {"items": [[_encoded(k, arrays), _encoded(v, arrays)] for k, v in value.items()]}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, PLAIN):
        return value
    raise TypeError(f"a stage result holds a {type(value).__name__}, which no stage file can hold")


def _decoded(tree: Any, hint: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """The value of a type; raises ValueError, KeyError or TypeError where the tree is none of it."""
    if hint in PLAIN:
        return _plain(tree, hint)
    if hint is np.ndarray:
        return arrays[_only(tree, "array")]
    if dataclasses.is_dataclass(hint):
        return _instance(tree, hint, arrays)
    kind, parts = kind_of(hint), get_args(hint)
    if kind is Union:
        return _any_of(tree, parts, arrays)
    if kind is Literal:
        return _one_of(tree, parts)
    if kind is dict:
        pairs = _only(tree, "items")
        return {_decoded(key, parts[0], arrays): _decoded(value, parts[1], arrays) for key, value in pairs}
    if not isinstance(tree, list):
        raise TypeError("a list is expected")
    each = parts[:1] * len(tree) if parts[-1] is ... else parts
    return tuple(_decoded(value, part, arrays) for value, part in zip(tree, each, strict=True))


def _plain(tree: Any, kind: Any) -> Any:
    # An integer is a number too; True, though an int to Python, is none.
    if type(tree) is kind or (tree is None and kind is type(None)) or (kind is float and type(tree) is int):
        return tree
    raise TypeError(f"a {kind.__name__} is expected")


def _only(tree: Any, key: str) -> Any:
    if not isinstance(tree, dict) or tree.keys() != {key}:
        raise TypeError(f"'{key}' alone is expected")
    return tree[key]


def _instance(tree: Any, cls: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    hints = field_hints(cls)
    if tree["class"] != cls.__name__ or tree["members"].keys() != hints.keys():
        raise ValueError(f"a {cls.__name__} is expected")
    members = {}
    for name, hint in hints.items():
        try:
            members[name] = _decoded(tree["members"][name], hint, arrays)
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{cls.__name__}.{name}: {error}") from error
    return cls(**members)


def _any_of(tree: Any, hints: tuple[Any, ...], arrays: Mapping[str, np.ndarray]) -> Any:
    reasons = []
    for hint in hints:
        try:
            return _decoded(tree, hint, arrays)
        except (ValueError, KeyError, TypeError) as error:
            reasons.append(str(error))
    raise ValueError(" or ".join(reasons))


def _one_of(tree: Any, values: tuple[Any, ...]) -> Any:
    for value in values:
        if type(value) is type(tree) and value == tree:
            return value
    raise ValueError("none of the values that are possible")
