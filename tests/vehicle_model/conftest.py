"""A process that has not chosen its engine yet."""

from __future__ import annotations

import pytest

from sysid import runtime
from sysid.vehicle_model import engine
from sysid.vehicle_model.native import kernel


@pytest.fixture
def unregistered(monkeypatch, tmp_path):
    """A process that has not loaded the engine yet, with empty cache folders."""
    monkeypatch.setenv("SYSID_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(runtime, "_user_cache", lambda: tmp_path / "own")
    caches = (engine._problem, engine._say_once, kernel._loaded, kernel.load, runtime._say)
    for cache in caches:
        cache.cache_clear()
    yield tmp_path
    for cache in caches:
        cache.cache_clear()
