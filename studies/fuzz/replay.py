"""What the fuzzer found, read once more as the product reads it: one content in a process of its own.

python -m studies.fuzz.replay TARGET FILE prints one line of JSON: outcome, processor time [s], peak memory [MB].
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

from studies.fuzz.targets import TARGETS
from studies.process import processor_seconds, status

#: What is promised of contents up to 10 MB: processor time [s], peak memory [MB].
MOST_SECONDS, MOST_MB = 10.0, 1000.0
#: Time on the clock after which a process is given up [s].
WAIT_S = 300.0
_ROOT = Path(__file__).resolve().parents[2]


def replay(name: str, file: Path) -> dict[str, Any]:
    """Outcome of one content: ``result``, ``sentence``, or what is wrong with it under ``wrong``."""
    command = [sys.executable, "-m", "studies.fuzz.replay", name, str(file.resolve())]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False, cwd=_ROOT)
    except subprocess.TimeoutExpired:
        return {"outcome": "none", "wrong": f"not done within {WAIT_S:g} s"}
    if done.returncode != 0:
        return {"outcome": "none", "wrong": done.stderr.strip()[-1500:] or f"exit code {done.returncode}"}
    found = dict(json.loads(done.stdout.splitlines()[-1]))
    if found["seconds"] > MOST_SECONDS:
        found["wrong"] = f"{found['seconds']:.1f} s"
    if found["MB"] > MOST_MB:
        found["wrong"] = f"{found['MB']:.0f} MB"
    return found


def main() -> None:
    """Read the file that the command line names."""
    from sysid.errors import SysidError

    name, file = sys.argv[1:]
    warnings.simplefilter("ignore")
    read, content = TARGETS[name].reader(), Path(file).read_bytes()
    began, outcome, said = processor_seconds(), "result", ""
    with tempfile.TemporaryDirectory() as place:
        try:
            read(Path(place), content)
        except SysidError as error:
            outcome, said = "sentence", str(error)
    # The peak of this process that getrusage tells outlives exec: it would be that of the process that started it.
    peak = max(status("VmHWM"), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024.0)
    found: dict[str, Any] = {"outcome": outcome, "said": said, "MB": round(peak / 1e6)}
    found["seconds"] = round(processor_seconds() - began, 2)
    if said and ("\n" in said or len(said) > 1000 or not said.endswith((".", "?"))):
        found["wrong"] = "not one sentence"
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
