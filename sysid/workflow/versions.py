"""Versions of what decides the numbers."""

from __future__ import annotations

import importlib.metadata
import platform


def versions() -> dict[str, str]:
    """Versions of this package, Python and the libraries that decide the numbers."""
    names = ("sysid", "numpy", "scipy", "jax", "jaxlib", "optimistix", "emcee", "pandas")
    found = {"python": platform.python_version()}
    for name in names:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found
