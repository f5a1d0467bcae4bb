"""How much memory is left for further processes."""

from __future__ import annotations

import os
from pathlib import Path

_LIMIT = Path("/sys/fs/cgroup/memory.max")
_USED = Path("/sys/fs/cgroup/memory.current")
_ALL = Path("/proc/meminfo")
#: Where the system does not say.
_UNKNOWN = 4_000_000_000


def available_bytes() -> int:
    """Memory that could be used without swapping [bytes], within the limit of a container."""
    limits = [n for n in (_of_machine(), _of_container()) if n is not None]
    return min(limits) if limits else _UNKNOWN


def _of_machine() -> int | None:
    try:
        for line in _ALL.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    try:
        return int(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return None


def _of_container() -> int | None:
    try:
        return max(0, int(_LIMIT.read_text()) - int(_USED.read_text()))
    except (OSError, ValueError):
        return None
