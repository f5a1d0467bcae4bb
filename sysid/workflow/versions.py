"""Versions of everything that determines the numbers."""

from __future__ import annotations

import importlib.metadata
import platform

from sysid.version import VERSION


def versions() -> dict[str, str]:
    """Versions of this package, Python and the libraries that determine the numbers."""
    names = ("numpy", "scipy", "jax", "jaxlib", "optimistix", "emcee", "pandas")
    by_name = {"python": platform.python_version(), "sysid": VERSION}
    for name in names:
        try:
            by_name[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            by_name[name] = "unknown"
    return by_name
