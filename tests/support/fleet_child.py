"""Stands in for the process that calibrates a campaign: same protocol, no calibration.

What it does stands in the file ``behaviour`` of the campaign folder; every start adds a line to ``starts`` of the
results.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path

from sysid.fleet import key
from sysid.fleet.child import ABANDONED
from sysid.fleet.key import calibration_key, file_digests, folder_state, result_digest
from sysid.fleet.outcome import Outcome

COMMAND = (sys.executable, str(Path(__file__).resolve()))


#: Stands in for the hash of all program code, which takes a second to compute.
DIGEST = "the same program"


def write_campaigns(root: Path, **behaviours: str) -> Path:
    """A folder of campaigns that behave as told, by name (``a_b`` for ``a-b``)."""
    for name, behaviour in behaviours.items():
        folder = root / name.replace("_", "-")
        folder.mkdir(parents=True)
        (folder / "campaign.toml").write_text(f'title = "{name}"\nlog = "behaviour"\n')
        (folder / "behaviour").write_text(behaviour)
    return root


def _leave_with_parent() -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    os._exit(ABANDONED)


def _say(what: dict) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Do what the campaign folder says."""
    key.program_digest = lambda: DIGEST
    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    campaign, output = Path(request["campaign"]), Path(request["output"])
    with (output / "starts").open("a") as stream:
        stream.write(f"{os.getpid()}\n")
    (output / "where").write_text(str(campaign))
    starts = len((output / "starts").read_text().splitlines())
    word, _, more = (campaign / "behaviour").read_text().strip().partition(" ")
    _say({"stage": "1 of 2 fit: least squares", "fraction": 0.25})
    if word == "die" or (word == "die-once" and starts == 1):
        sys.stderr.write("a wild pointer\n")
        sys.stderr.flush()
        os.kill(os.getpid(), signal.SIGSEGV)
    if word == "wait" or (word == "wait-once" and starts == 1):
        time.sleep(float(more))
    if request.get("prior") is not None:
        (output / "prior.json").write_text(json.dumps(request["prior"]))
        outcome = Outcome("done", status="converged")
    elif word in ("rejected", "failed"):
        inputs = folder_state(campaign)
        outcome = Outcome(word, more, "", calibration_key(inputs, request["choices"]), inputs)
    else:
        inputs = file_digests(campaign, ["campaign.toml"])
        text = json.dumps({"timings": {"all": time.time()}, "threads": os.environ["SYSID_THREADS"], "word": word})
        (output / "result.json").write_text(text)
        outcome = Outcome(
            "not converged" if word == "not-converged" else "done",
            "",
            "not_converged" if word == "not-converged" else "converged",
            calibration_key(inputs, request["choices"]),
            inputs,
            result_digest(output / "result.json"),
        )
    _say({"outcome": asdict(outcome)})


if __name__ == "__main__":
    main()
