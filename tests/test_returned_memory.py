"""Memory that is free goes back to the system when it is asked to."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from studies.process import status
from sysid.cli.main import main
from sysid.runtime import _of_glibc, _Process, fewer_collections, forget_compiled, return_memory


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


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs /proc")
def test_compiled_functions_are_let_go_before_they_take_all_mappings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in a notebook: Linux ends a process that asks for more mappings than it grants."""

    def count() -> int:
        return len(Path("/proc/self/maps").read_text().splitlines())

    monkeypatch.setattr("sysid.runtime._Process.ours", False)
    forget_compiled()
    before = count()
    functions = [jax.jit(lambda x, n=n: n * x + n) for n in range(40)]
    assert [f(1.0) for f in functions] == [2.0 * n for n in range(40)]
    taken = count() - before
    assert taken > 40
    monkeypatch.setattr("sysid.runtime._granted_mappings", lambda: 2.5 * count())
    forget_compiled()
    assert count() - before > 0.9 * taken
    monkeypatch.setattr("sysid.runtime._granted_mappings", lambda: 1.5 * count())
    forget_compiled()
    assert count() - before < 0.5 * taken
    assert functions[1](1.0) == 2.0


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


_FROZEN = """
import gc, sys
from sysid.runtime import configure, own_process, require_64_bit
if sys.argv[1] == "ours":
    own_process()
for _ in range(2):
    configure()
    require_64_bit()
    kept = [object() for _ in range(1000)]
    print(gc.get_freeze_count())
"""


@pytest.mark.parametrize("whose", ["ours", "another's"])
def test_imported_modules_are_left_out_of_garbage_collection_in_a_process_of_our_own(whose: str) -> None:
    """Once: what is computed later is collected when nothing refers to it any more."""
    said = subprocess.run(
        [sys.executable, "-c", _FROZEN, whose], check=True, capture_output=True, text=True
    ).stdout.split()
    first, second = map(int, said)
    assert (first > 10_000) if whose == "ours" else (first == 0)
    assert second <= first


@pytest.mark.parametrize("ours", [True, False])
def test_garbage_is_collected_less_often_only_while_it_is_asked_for(monkeypatch, ours: bool) -> None:
    monkeypatch.setattr(_Process, "ours", ours)
    before = gc.get_threshold()
    with fewer_collections():
        assert (gc.get_threshold() != before) == ours
    assert gc.get_threshold() == before
    with pytest.raises(ZeroDivisionError), fewer_collections():
        _ = 1 / 0
    assert gc.get_threshold() == before
