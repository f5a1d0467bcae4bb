"""Reads one file in a process of its own and says what it took: the outcome, seconds, and peak memory.

As a program: ``python measured_read.py READER PATH`` prints one line of JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.bounded_reader import end_readers

#: What the fuzz promises of any file.
MOST_SECONDS = 2.0
MOST_BYTES = 500e6


@dataclass(frozen=True)
class Outcome:
    """`kind` is ``read``, the name of an error of the package, or ``traceback``; `bytes` is the peak of the process."""

    kind: str
    text: str
    seconds: float
    bytes: float


def readers() -> dict[str, Callable[[Path], Any]]:
    """Every reader of files from strangers, as a function of the path."""
    from sysid.campaign import Sensor, read_campaign, read_log
    from sysid.road import read_point_cloud
    from sysid.road.profile_files import bump_from_file

    sensors = (
        Sensor("q_mm", "suspension_deflection", "mm", axle=0, full_scale=0.15),
        Sensor("a_g", "axle_acceleration", "g", axle=0),
    )
    return {
        "campaign": read_campaign,
        "log": lambda path: read_log(path, path.name, sensors, 0.01),
        "cloud": read_point_cloud,
        "profile": bump_from_file,
        "drop": lambda path: _drop(read_log(path, path.name, sensors, 0.01)),
        "scan": lambda path: _scan(path, read_point_cloud(path)),
    }


def _drop(log: Any) -> Any:
    from sysid.sdof import read_decay

    return read_decay(log.channels[0].time_s, log.channels[0].value)


def _scan(path: Path, points: Any) -> Any:
    from sysid.campaign.records import Scan
    from sysid.road import analyse_scan

    return analyse_scan(Scan("bump", path.name, 0.0, points))


def read(reader: Callable[[Path], Any], path: Path) -> tuple[str, str]:
    """Kind and text of the outcome of one reading in this process."""
    from sysid.errors import SysidError

    try:
        reader(path)
    except SysidError as error:
        return type(error).__name__, str(error)
    # The very thing that is looked for.
    except Exception as error:
        return "traceback", f"{type(error).__name__}: {error}"
    return "read", ""


def measured(reader: str, path: Path, timeout_s: float = 300.0) -> Outcome:
    """Read a file in a new process; its processor time is without starting Python and loading libraries."""
    command = [sys.executable, "-P", __file__, reader, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
    with contextlib.suppress(ValueError, TypeError):
        return Outcome(**json.loads(done.stdout))
    return Outcome("traceback", done.stderr[-500:], float("nan"), float("nan"))


def main() -> None:
    """Read the file named on the command line."""
    import resource

    reader, path = readers()[sys.argv[1]], Path(sys.argv[2])
    with tempfile.TemporaryDirectory() as folder:
        # Libraries are loaded by the first file, whatever is in it: half a second that is not the file's.
        small = Path(folder) / path.name
        small.write_bytes(b"1,2,3\n")
        read(reader, small)
    begin = _processor_s()
    kind, text = read(reader, path)
    seconds = _processor_s() - begin
    peak = max(_peak_bytes(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024.0)
    sys.stdout.write(json.dumps({"kind": kind, "text": text, "seconds": seconds, "bytes": peak}))


def _processor_s() -> float:
    """Processor time of this process and its children [s]: other work on the machine does not count."""
    end_readers()
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _peak_bytes() -> float:
    """Peak memory since this program began; the one of `getrusage` counts the process that started it as well."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024.0 * int(status.split("VmHWM:")[1].split()[0])


if __name__ == "__main__":
    main()
