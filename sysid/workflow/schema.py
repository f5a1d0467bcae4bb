"""Schema of a stage's result: read off the type hints of its frozen dataclasses.

It serves twice. The hash of a text of all classes, fields and types shows whether a file was written for a result of
the same content (:func:`schema_digest`). A stage file is decoded by the hints, so that only the declared classes are
ever built, from members of the declared names and types (:mod:`sysid.workflow.store`).
"""

from __future__ import annotations

import ast
import collections.abc
import dataclasses
import hashlib
import importlib
import inspect
import re
import sys
import types
import typing
from collections.abc import Callable
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from sysid.workflow.stage import Itemwise, Stage, Whole

#: Possible types of a value without parts.
PLAIN = (bool, int, float, str, type(None))


def result_hint(stage: Stage[Any]) -> Any:
    """The type of a stage's result: the return annotation of its compute function."""
    if isinstance(stage, Whole):
        return function_hints(stage.compute)["return"]
    assert isinstance(stage, Itemwise)
    # An iterator of pairs (name, item).
    ((_, item),) = (get_args(pair) for pair in get_args(function_hints(stage.each)["return"]))
    return dict[str, item]  # type: ignore[valid-type]


@cache
def function_hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Type hints of a function, those of names imported for annotations only among them."""
    names = _guarded_names(function.__module__, " ".join(map(str, function.__annotations__.values())))
    return typing.get_type_hints(function, localns=names)


@cache
def field_hints(cls: type) -> dict[str, Any]:
    """Type hints of a dataclass's fields by name; a kind of tuple is kept as the tuple that it is."""
    names: dict[str, Any] = {}
    for base in cls.__mro__:
        words = " ".join(map(str, inspect.get_annotations(base).values()))
        names |= _guarded_names(base.__module__, words)
    hints = typing.get_type_hints(cls, localns=names)
    return {f.name: _as_tuple(hints[f.name]) for f in dataclasses.fields(cls)}


def _as_tuple(hint: Any) -> Any:
    if not (isinstance(hint, type) and issubclass(hint, tuple)):
        return hint
    return next((base for base in getattr(hint, "__orig_bases__", ()) if get_origin(base) is tuple), hint)


def schema_digest(hint: Any) -> str:
    """Hash of everything that a result may hold: classes, their fields, and the fields' types, recursively."""
    return hashlib.sha256(schema_text(hint).encode()).hexdigest()


@cache
def schema_text(hint: Any) -> str:
    """A type in words that change with any field below it.

    Raises TypeError for a type that no stage file can hold.
    """
    if hint in PLAIN or hint is np.ndarray:
        return str(hint.__name__)
    if dataclasses.is_dataclass(hint):
        members = ", ".join(f"{name}: {schema_text(of)}" for name, of in field_hints(hint).items())  # type: ignore[arg-type]
        return f"{hint.__name__}({members})"  # type: ignore[union-attr]
    kind = kind_of(hint)
    if kind is Literal:
        return f"Literal{list(get_args(hint))!r}"
    parts = ["..." if arg is ... else schema_text(arg) for arg in get_args(hint)]
    return f"{getattr(kind, '__name__', kind)}[{', '.join(parts)}]"


def kind_of(hint: Any) -> Any:
    """``tuple``, ``dict``, ``Union`` or ``Literal``: what a type with parameters is made of.

    Raises TypeError for any other.
    """
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return Union
    if origin in (tuple, Literal):
        return origin
    if origin in (dict, collections.abc.Mapping):
        return dict
    raise TypeError(f"{hint} cannot be kept in a stage file")


def _guarded_names(module: str, words: str) -> dict[str, Any]:
    """What of `words` the module imports under ``if TYPE_CHECKING``: get_type_hints does not see these."""
    wanted = set(re.findall(r"[A-Za-z_]\w*", words))
    guarded = _guarded_imports(module)
    found = {name: (importlib.import_module(guarded[name][0]), guarded[name][1]) for name in wanted & guarded.keys()}
    return {name: getattr(source, of) if of else source for name, (source, of) in found.items()}


@cache
def _guarded_imports(module: str) -> dict[str, tuple[str, str]]:
    """Of every name that a module of this package imports under ``if TYPE_CHECKING``, its module and the name there.

    The name is empty for NumPy, the one module that annotations name.
    """
    module_of: dict[str, tuple[str, str]] = {}
    if not module.startswith("sysid"):
        return module_of
    for node in ast.parse(inspect.getsource(sys.modules[module])).body:
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            for line in node.body:
                if isinstance(line, ast.ImportFrom) and line.module and line.module.startswith("sysid"):
                    module_of |= {alias.name: (line.module, alias.name) for alias in line.names}
                elif isinstance(line, ast.Import):
                    module_of |= {a.asname or a.name: (a.name, "") for a in line.names if a.name == "numpy"}
    return module_of
