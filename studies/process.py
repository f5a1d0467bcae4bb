"""What this process takes: memory, open files and threads, as Linux says; zero elsewhere."""

from __future__ import annotations

import os
from pathlib import Path

from sysid.bounded_reader import end_readers


def status(name: str) -> float:
    """A line of /proc/self/status: ``VmRSS`` memory, ``VmHWM`` its peak [bytes], or ``Threads``."""
    try:
        text = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    number, *unit = text.split(f"{name}:")[1].split("\n")[0].split()
    return float(number) * (1024.0 if unit else 1.0)


def reset_peak() -> float:
    """Set the peak memory of this process to what it has now, and return that [bytes]."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return status("VmHWM")
    return status("VmRSS")


def processor_seconds() -> float:
    """Processor time of this process and of the children that it has waited for [s]."""
    end_readers()
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def open_files() -> int:
    """How many handles the process holds."""
    try:
        return len(os.listdir("/proc/self/fd")) - 1
    except OSError:
        return 0
