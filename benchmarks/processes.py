"""What needs a fresh process: imports, help, the first likelihood with and without caches, memory, complete fits."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.rounds import Contender, Sample, ratio, run_rounds, spread
from benchmarks.work import CAMPAIGN, ROOT

TIMEOUT_S = 900.0
SETS_FOR_MEMORY = 256


def child(arguments: list[str], cache: Path | None = None) -> tuple[Sample, str]:
    """Wall-clock and processor seconds of a Python process, and its output.

    Raises
    ------
    RuntimeError
        If it fails, with the end of what it said.
    """
    environment = dict(os.environ)
    if cache is not None:
        environment["SYSID_CACHE_DIR"] = str(cache)
    before, start = os.times(), time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    wall, after = time.perf_counter() - start, os.times()
    if done.returncode != 0:
        raise RuntimeError(f"`python {' '.join(arguments)}` failed: {done.stderr.strip()[-500:]}")
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return Sample(wall, used), done.stdout


def imports(rounds: int, limit_s: float) -> dict[str, Any]:
    """Import of the package against that of jax alone, and the help of the command line."""
    commands = {
        "python": ["-c", "pass"],
        "import jax": ["-c", "import jax"],
        "import sysid": ["-c", "import sysid"],
        "import sysid.workflow": ["-c", "import sysid.workflow"],
        "calibrate.py --help": ["calibrate.py", "--help"],
    }
    contenders = [Contender(name, lambda a=a: child(a)[0]) for name, a in commands.items()]  # type: ignore[misc]
    run_rounds(contenders, rounds, limit_s)
    by_name = {c.name: c for c in contenders}
    found: dict[str, Any] = {
        name: {what: spread(list(c.per_unit(what).values())) for what in ("wall_s", "processor_s")}
        for name, c in by_name.items()
    }
    for name in ("import sysid", "import sysid.workflow"):
        found[f"{name} / import jax"] = {
            what: ratio(by_name[name], by_name["import jax"], what) for what in ("wall_s", "processor_s")
        }
    return found


def first_likelihoods(folder: Path, engines: tuple[str, ...], warm_rounds: int) -> dict[str, Any]:
    """Seconds of a fresh process up to its first batch of 64 sets on one run, with empty and with full caches."""
    found: dict[str, Any] = {}
    for name in engines:
        cache = folder / f"cache-{name}"
        shutil.rmtree(cache, ignore_errors=True)
        every = [_first(name, [], cache) for _ in range(1 + warm_rounds)]
        found[name] = {
            "cold_s": every[0]["first_likelihood_s"],
            "warm_s": spread([f["first_likelihood_s"] for f in every[1:]]),
        }
    return found


def memory(engines: tuple[str, ...], runs: int) -> dict[str, Any]:
    """Peak memory of a process that computes a batch of 256 sets on the whole campaign."""
    wanted = ["--sets", str(SETS_FOR_MEMORY), "--runs", *(str(r) for r in range(runs))]
    return {name: _first(name, wanted, None) for name in engines}


def _first(name: str, wanted: list[str], cache: Path | None) -> dict[str, float]:
    found: dict[str, float] = json.loads(
        child(["-m", "benchmarks.first_likelihood", "--engine", name, *wanted], cache)[1]
    )
    return found


def complete_fits(folder: Path) -> dict[str, Any]:
    """`calibrate.py fit` on the linear truck with an empty cache, then with a full one: timings of result.json."""
    cache, found = folder / "cache-fit", {}
    shutil.rmtree(cache, ignore_errors=True)
    for name in ("cold", "warm"):
        output = folder / f"fit-{name}"
        shutil.rmtree(output, ignore_errors=True)
        sample, _ = child(["calibrate.py", "fit", str(CAMPAIGN), "--output", str(output)], cache)
        timings = json.loads((output / "result.json").read_text(encoding="utf-8"))["timings"]
        found[name] = {"stages_s": timings, "process_s": sample.wall_s, "processor_s": sample.processor_s}
    return found
