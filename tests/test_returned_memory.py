"""Memory that is free goes back to the system when it is asked to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from studies.process import status
from sysid.runtime import _of_glibc, return_memory


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
