"""The processor of this machine, as Linux tells it: what compiled code depends on, and what it may use."""

from __future__ import annotations

import platform
from pathlib import Path

_CPUINFO = Path("/proc/cpuinfo")


def description() -> str:
    """Model and instruction sets of the first core."""
    lines = _lines()
    first = lines[: lines.index("")] if "" in lines else lines
    wanted = ("model name", "flags", "Features", "CPU part")
    return " ".join([platform.processor(), *(x for x in first if x.startswith(wanted))])


def flags() -> frozenset[str]:
    """Instruction sets that all cores have, by the names that Linux gives them; none where it does not say."""
    of_cores = [set(line.partition(":")[2].split()) for line in _lines() if line.partition(":")[0].strip() == "flags"]
    return frozenset(set.intersection(*of_cores)) if of_cores else frozenset()


def _lines() -> list[str]:
    try:
        return _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
