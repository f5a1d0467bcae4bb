"""Memory that is free goes back to the system when it is asked to."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from studies.process import status
from sysid.cli.main import main
from sysid.runtime import _of_glibc, _Process, forget_compiled, return_memory


@pytest.mark.skipif(
    not Path("/proc/self/status").exists() or _of_glibc("malloc_trim") is None, reason="needs glibc and /proc"
)
def test_free_memory_behind_a_block_in_use_goes_back() -> None:
    # Blocks below the size that has pages of its own; the last one keeps the heap from shrinking.
    blocks = [np.ones(8000) for _ in range(2500)]
    last = blocks[-1]
    blocks.clear()
    before = status("VmRSS")
    return_memory()
    assert before - status("VmRSS") > 100e6
    assert last.sum() == 8000.0


def test_compiled_functions_are_let_go_in_a_grown_process_of_our_own_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    double = jax.jit(lambda x: 2.0 * x)
    assert double(3.0) == 6.0
    forget_compiled()
    assert double._cache_size() == 1
    monkeypatch.setattr("sysid.runtime._Process.ours", True)
    monkeypatch.setattr("sysid.runtime._GROWN", 1e15)
    forget_compiled()
    assert double._cache_size() == 1
    forget_compiled(0.0)
    assert double._cache_size() == 0
    assert double(3.0) == 6.0
    monkeypatch.setattr("sysid.runtime._GROWN", 1e6)
    forget_compiled()
    assert double._cache_size() == 0
    assert double(3.0) == 6.0


_HEAPS_OF_THREADS = """
import ctypes, sys, threading
from sysid.runtime import configure
configure()
library, ready = ctypes.CDLL(None), threading.Barrier(9)
library.malloc.restype = library.fopen.restype = ctypes.c_void_p
def hold():
    library.malloc(50_000)
    ready.wait()
for _ in range(8):
    threading.Thread(target=hold).start()
ready.wait()
library.fopen.argtypes = [ctypes.c_char_p, ctypes.c_char_p]
library.malloc_info.argtypes, library.fclose.argtypes = [ctypes.c_int, ctypes.c_void_p], [ctypes.c_void_p]
file = library.fopen(sys.argv[1].encode(), b"w")
library.malloc_info(0, file)
library.fclose(file)
"""


@pytest.mark.skipif(_of_glibc("malloc_info") is None, reason="needs glibc")
@pytest.mark.parametrize(("asked", "heaps"), [(None, {1, 2}), ("5", {5})])
def test_threads_share_few_heaps(tmp_path: Path, asked: str | None, heaps: set[int]) -> None:
    """The user's own number of heaps goes before ours."""
    environment = {k: v for k, v in os.environ.items() if k != "MALLOC_ARENA_MAX"}
    environment |= {} if asked is None else {"MALLOC_ARENA_MAX": asked}
    said = tmp_path / "heaps.xml"
    subprocess.run([sys.executable, "-c", _HEAPS_OF_THREADS, str(said)], env=environment, check=True)
    assert said.read_text().count("<heap nr=") in heaps


def test_the_command_line_has_a_process_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.runtime._Process.ours", False)
    monkeypatch.setattr("sysid.cli.main.cli", lambda **given: None)
    main()
    assert _Process.ours
