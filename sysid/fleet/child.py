"""The process that calibrates one campaign: ``python -m sysid.fleet.child``, started by :mod:`sysid.fleet.task`.

The first line of its input is the request as JSON; the end of its input means that nobody waits for it any more, and it
stops.  It writes one JSON object per line: how far it is, and at last what became of the campaign.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import sys
import threading
import time
import traceback
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sysid.bounded_reader import end_readers
from sysid.errors import OutputError, SysidError
from sysid.files import keep_inside, read_bytes, write_text
from sysid.fleet.draws import record_digest
from sysid.fleet.key import calibration_key, chain_key, file_digests, folder_state, result_digest
from sysid.fleet.outcome import LOG_FILE, RESULT_FILE, Outcome
from sysid.folder_lock import FolderInUseError, FolderLock, cannot_write
from sysid.runtime import own_process

#: Exit status of a process that nobody waits for.
ABANDONED = 75
_KEY_FILE = "fleet_key"
#: How long to wait for the process of an earlier driver to see that it is gone [s]: a worker that lost its scheduler
#: takes half a minute to end.
_PATIENCE_S = 60.0
#: Least time between two lines about progress [s].
_INTERVAL_S = 0.5


def main() -> None:
    """Calibrate the requested campaign and say what became of it."""
    own_process()
    say = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8", buffering=1)
    # Whatever a library prints belongs into the log.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    campaign, output, reports = Path(request["campaign"]), Path(request["output"]), _Reports(say)
    keep_inside(output.parents[1])
    if request.get("prior") is None:
        outcome = calibrate(campaign, output, request["choices"], reports)
    else:
        outcome = recalibrate(campaign, output, request["prior"], reports)
    say.write(json.dumps({"outcome": asdict(with_cost(outcome))}) + "\n")
    say.flush()


def calibrate(campaign: Path, output: Path, choices: dict[str, Any], progress: Any) -> Outcome:
    """All stages of one campaign into its folder, going on from what is there; never raises."""
    inputs: dict[str, str] = {}
    try:
        _wait_for_folder(output)
        inputs, status = _run(campaign, output, choices, progress)
        return Outcome(
            state="not converged" if status == "not_converged" else "done",
            status=status,
            key=calibration_key(inputs, choices),
            inputs=inputs,
            result_sha256=result_digest(output / RESULT_FILE),
            file_sha256=file_digests(output, [RESULT_FILE])[RESULT_FILE],
            draws_sha256=record_digest(output),
        )
    except FolderInUseError as error:
        # It has no key: the next run tries it again.
        return _failed(error, output)
    except Exception as error:
        failed = _failed(error, output)
    inputs = folder_state(campaign)
    return replace(failed, key=calibration_key(inputs, choices), inputs=inputs)


def recalibrate(campaign: Path, output: Path, prior: dict[str, Any], progress: Any) -> Outcome:
    """Sample a finished campaign once more under the prior of its population; never raises."""
    from sysid.fleet.population_prior import PopulationPrior
    from sysid.fleet.resample import sample_again

    try:
        _wait_for_folder(output)
        converged = sample_again(campaign, output, PopulationPrior.from_dict(prior), progress)
    except Exception as error:
        return _failed(error, output)
    if converged:
        return Outcome("done", status="converged")
    return Outcome("not converged", "its draws under the population have not converged; its earlier draws are kept")


def _failed(error: Exception, output: Path) -> Outcome:
    """What an error in a campaign is: data or file that cannot be used, or a disk or program that failed."""
    if isinstance(error, SysidError):
        return Outcome("failed" if isinstance(error, OutputError) else "rejected", str(error))
    traceback.print_exception(error)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT):
        return Outcome("failed", str(cannot_write(output, error)))
    return Outcome("failed", f"an unexpected error stopped it ({type(error).__name__}: {error}); see {LOG_FILE}")


def with_cost(outcome: Outcome) -> Outcome:
    """The outcome with what this process and the children that it has waited for have used so far."""
    end_readers()
    used = os.times()
    seconds = used.user + used.system + used.children_user + used.children_system
    return replace(outcome, processor_seconds=round(seconds, 3), peak_bytes=peak_bytes())


def peak_bytes() -> int:
    """Largest memory of this process so far, 0 where the system does not say."""
    # What getrusage tells on Linux outlives exec: it would be at least the memory of the process that started this one.
    with suppress(OSError, ValueError, IndexError):
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return 1024 * int(status.split("VmHWM:")[1].split()[0])
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else 1024 * peak)


def _run(campaign: Path, output: Path, choices: dict[str, Any], progress: Any) -> tuple[dict[str, str], str]:
    from sysid.fleet.draws import write_record
    from sysid.workflow import Calibration, make_settings

    calibration = Calibration(campaign, output, make_settings(**choices), progress, resume=True)
    inputs = dict(calibration.campaign.input_sha256)
    key = chain_key(inputs, choices)
    before = read_bytes(output / _KEY_FILE)
    if before is not None and before.decode(errors="replace") != key:
        # A chain of other inputs would be refused; stages that do not depend on the change are still read back.
        shutil.rmtree(output / "chain", ignore_errors=True)
    write_text(output / _KEY_FILE, key)
    results = calibration.run()
    write_record(calibration, results, output)
    return inputs, results.status


def _wait_for_folder(output: Path) -> None:
    """Give a process whose driver has been killed the time to see it."""
    end = time.monotonic() + _PATIENCE_S
    while True:
        try:
            with FolderLock(output):
                return
        except FolderInUseError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def _leave_with_parent() -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    # Files are complete or absent and the chain is kept by segments: leaving at once loses nothing.
    os._exit(ABANDONED)


class _Reports:
    """Progress as lines of JSON, at most two a second."""

    def __init__(self, say: Any):
        self._say, self._last = say, 0.0

    def __call__(self, message: str, fraction: float) -> None:
        now = time.monotonic()
        if now - self._last >= _INTERVAL_S:
            self._last = now
            self._say.write(json.dumps({"stage": message, "fraction": round(fraction, 4)}) + "\n")


if __name__ == "__main__":
    main()
