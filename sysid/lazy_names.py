"""Public names of a package that are loaded when they are first used (PEP 562), so that importing it stays light."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any


def lazy_names(
    package: str, homes: Mapping[str, str], submodules: Iterable[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package whose names live elsewhere.

    Parameters
    ----------
    package : its `__name__`.
    homes : module of every name.
    submodules : modules directly under the package that are names of it too.

    Raises
    ------
    AttributeError
        By `__getattr__`, for any other name.
    """
    modules = frozenset(submodules)

    def load(name: str) -> Any:
        """Load a public name when it is first used."""
        if name in modules:
            return importlib.import_module(f"{package}.{name}")
        if name in homes:
            return getattr(importlib.import_module(homes[name]), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted({*vars(importlib.import_module(package)), *homes, *modules})

    return load, names
