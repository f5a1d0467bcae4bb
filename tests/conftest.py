"""Settings of the whole suite: 64-bit floats, and compiled functions kept between test runs.

They are set through the environment, before JAX is imported and also for child processes, so that tests which need no
JAX do not load it.
"""

from __future__ import annotations

import os
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / "support"))

# The same folder layout as `sysid.runtime`: one folder per version, so that an update never meets stale entries.
_CACHE = Path(__file__).resolve().parents[1] / "build" / "cache"
_SETTINGS = {
    "SYSID_CACHE_DIR": str(_CACHE),
    # Matrices are small here: more threads only wait for each other.
    "OPENBLAS_NUM_THREADS": "1",
    "JAX_ENABLE_X64": "1",
    "JAX_PLATFORMS": "cpu",
    "JAX_COMPILATION_CACHE_DIR": str(_CACHE / f"jax-{version('jax')}"),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}
os.environ.update(_SETTINGS)


def pytest_configure(config: pytest.Config) -> None:
    """A cache entry that a killed run left half-written costs a compilation, not a failed test.

    Nor does a checkout that others can write to, whose build folder is no place for compiled code.
    """
    config.addinivalue_line("filterwarnings", "ignore:Compiled code is :UserWarning")
    config.addinivalue_line("filterwarnings", "ignore:Error (reading|writing) persistent compilation cache:UserWarning")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What a run without a C++ compiler has left out is seen without an option."""
    skipped = [r for r in terminalreporter.stats.get("skipped", []) if "no C++ compiler" in str(r.longrepr)]
    if skipped:
        terminalreporter.section("native engine not tested", yellow=True)
        terminalreporter.line(
            f"{len(skipped)} tests of the native engine were skipped: there is no C++ compiler on this machine. "
            "Install g++ or clang++, or name one with CXX, and run them again."
        )
