"""Floating-point operations of a likelihood, their rate, and what the machine can do at most.

``python -m benchmarks.flops [--output build/benchmarks] [--rounds 15] [--document docs/evidence/benchmarks.md]``
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bare_kernel import compile_sources, write_call
from benchmarks.flop_count import copied_sources, count, counting_program
from benchmarks.flop_table import write_table
from benchmarks.machine import describe
from sysid.runtime import configure
from sysid.vehicle_model.native import build

SETS = 64
RUNS = (0, 1, 8, 9)
RICHEST = frozenset({"friction", "asymmetric_damper", "gas_spring", "estimated_bump_stops"})
LAWS: dict[str, frozenset[str] | None] = {"linear": None, "richest": RICHEST}
#: What limits the rate: builds of changed sources or with other flags; file, text and replacement.
VARIANTS: dict[str, tuple[tuple[tuple[str, str, str], ...], tuple[str, ...]]] = {
    "as it is": ((), ()),
    "x^n costs nothing": ((("pack.h", "return power_of_two(n * binary_logarithm(x));", "return n + x;"),), ()),
    "filters cost nothing": ((("integration.h", "memory.advance(now.data(), middle.data());", ""),), ()),
    "no multiply-add is fused": ((), ("-ffp-contract=off",)),
    "four lanes (AVX2)": ((), ("-march=x86-64-v3",)),
}


def main() -> None:
    """Count, measure, write ``flops.json`` and on request the table of the documentation."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.flops", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/benchmarks"))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--document", type=Path, help="page to write the table to")
    options = parser.parse_args()
    configure()
    folder: Path = options.output / "flops"
    folder.mkdir(parents=True, exist_ok=True)
    calls = {name: _call(folder / f"{name}.bin", laws) for name, laws in LAWS.items()}
    machine = describe()
    operations = {name: count(counting_program(folder), file, SETS) for name, file in calls.items()}
    found = {
        "machine": machine,
        "operations": {name: of._asdict() for name, of in operations.items()},
        "peak": peaks(folder),
        "seconds": rates(folder, list(calls.values()), options.rounds),
        "laws": list(calls),
    }
    path = options.output / "flops.json"
    path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.document is not None:
        write_table(json.loads(path.read_text(encoding="utf-8")), options.document)


def _call(file: Path, laws: frozenset[str] | None) -> Path:
    from benchmarks.work import density, linear_truck, make_work, nominal_point

    every = None if laws is None else [laws] * len(linear_truck()[0].vehicle.axles)
    work = make_work(nominal_point(every), RUNS, every)
    write_call(file, work, density(work, "native"), work.sets(SETS))
    return file


def peaks(folder: Path, repeats: int = 5) -> dict[str, Any]:
    """GF/s of fused multiply-adds: lanes -> of one core, of all together; the best of some."""
    program = folder / "peak"
    compiler = build.find_compiler()
    if compiler is None:
        raise build.BuildError("no C++ compiler was found")
    source = str(Path(__file__).parent / "bare" / "peak.cpp")
    subprocess.run(
        [*compiler, "-std=c++17", "-O3", "-march=native", "-pthread", source, "-o", str(program)], check=True
    )
    best: dict[str, dict[str, float]] = {}
    for threads in (1, os.cpu_count() or 1):
        for _ in range(repeats):
            text = subprocess.run([str(program), str(threads)], capture_output=True, text=True, check=True).stdout
            for line in text.splitlines():
                lanes, core, together, wait = line.split()
                one = best.setdefault(lanes, {"core": 0.0, "together": 0.0, "dependent_ns": np.inf})
                one["core"] = max(one["core"], float(core))
                one["together"] = max(one["together"], float(together))
                one["dependent_ns"] = min(one["dependent_ns"], float(wait))
    return best


def rates(folder: Path, files: list[Path], rounds: int) -> dict[str, list[dict[str, Any]]]:
    """Processor seconds of all variants in turn, on one core and on all, and the sums of the misfits."""
    programs = {name: _variant(folder, name) for name in VARIANTS}
    running = {}
    for name, program in programs.items():
        for threads in (1, os.cpu_count() or 1):
            running[name, threads] = subprocess.Popen(
                [str(program), *map(str, files)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=os.environ | {"SYSID_THREADS": str(threads)},
            )
    found: dict[tuple[str, int, int], list[tuple[float, ...]]] = {}
    for _ in range(rounds):
        for (name, threads), process in running.items():
            for k in range(len(files)):
                assert process.stdin is not None
                assert process.stdout is not None
                process.stdin.write(f"{k} 1\n")
                process.stdin.flush()
                found.setdefault((name, threads, k), []).append(tuple(map(float, process.stdout.readline().split())))
    for process in running.values():
        process.communicate()
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in VARIANTS}
    for (name, threads, k), samples in found.items():
        wall, processor, misfit = np.array(samples).T
        rows[name].append(
            {
                "threads": threads,
                "call": k,
                "processor_s": np.percentile(processor, [25, 50, 75]).tolist(),
                "wall_s": np.percentile(wall, [25, 50, 75]).tolist(),
                "misfit": misfit[0],
            }
        )
    return rows


def _variant(folder: Path, name: str) -> Path:
    replaced, flags = VARIANTS[name]
    home = folder / "".join(c if c.isalnum() else "_" for c in name)
    shutil.rmtree(home, ignore_errors=True)
    home.mkdir()
    return compile_sources(home / "kernel", copied_sources(home / "sources", replaced), flags)


if __name__ == "__main__":
    sys.exit(main())
