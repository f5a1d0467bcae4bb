"""Command line of the fuzzer.

    python -m studies.fuzz [TARGET ...] [--seconds N] [--jobs N] [--output DIR] [--document FILE] [--tables-only]

feeds every reader, or those that are named, with contents that atheris (libFuzzer) makes from real files, guided by the
code that they reach, for N seconds of processor time each.  What is found is read once more as the product reads it.
What libFuzzer keeps in DIR/TARGET/corpus is where the next call goes on; the figures of a reader stay in FILE until it
is fuzzed again.  A call that was stopped is continued by the next one with the same DIR and the same code; before that,
end what it left running (`pkill -f studies.fuzz`).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from studies.documents import write_between_marks
from studies.fuzz.replay import replay
from studies.fuzz.table import table
from studies.fuzz.targets import TARGETS

#: Contents above this are fuzzed but not kept for the next process, which would take the memory of all of them [bytes].
_KEPT_BYTES = 200_000
#: Options of libFuzzer: time on the clock of one content [s], memory of the process [MB], size of a content [bytes].
_OPTIONS = ("-timeout=60", "-rss_limit_mb=1000", "-max_len=10000000", "-print_final_stats=1", "-report_slow_units=60")
_SUMS = ("inputs", "refused", "stopped", "processor_s")
_COVERAGE = re.compile(r"^#\d+\s+\w+\s+cov: (\d+)", re.MULTILINE)
_ROOT = Path(__file__).resolve().parents[2]
#: Figures of a call before its last process, in the folder of a reader until its time is used.
_STOPPED = "stopped.json"
#: What is kept of the lines that a process prints last: so many, and so many bytes of each.
_LAST_LINES, _LINE_BYTES = 200, 4096
#: So many processes in a row that end before they count anything: more would not end either.
_MOST_FAILED = 5


def fuzz(name: str, folder: Path, seconds: float) -> dict[str, Any]:
    """Fuzz one reader for some processor time; processes that die are started again.  Figures and findings."""
    for part in ("seeds", "corpus", "findings"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for seed, content in TARGETS[name].seeds().items():
        (folder / "seeds" / seed).write_bytes(content)
    totals, places = _continued(folder)
    if not places:
        # The seeds alone: what they reach is where the count begins.
        places = [int(count) for count in _COVERAGE.findall(_run(name, folder, ("-runs=0", str(folder / "seeds"))))]
    failed = 0
    # libFuzzer counts time on the clock, so it is started again until the processor time is used.
    while (left := seconds - totals["processor_s"]) > max(5.0, 0.01 * seconds):
        for kept in (folder / "corpus").iterdir():
            if kept.stat().st_size > _KEPT_BYTES:
                kept.unlink()
        before = _ended_processes(folder)
        _keep(folder, totals, places)
        options = (f"-max_total_time={left:.0f}", f"-artifact_prefix={folder}/findings/native-")
        said = _run(name, folder, (*options, str(folder / "corpus"), str(folder / "seeds")))
        failed = 0 if _add(totals, folder / "worker.json") else failed + 1
        places += [int(count) for count in _COVERAGE.findall(said)]
        totals["died"] += len(_ended_processes(folder) - before)
        if not places or failed == _MOST_FAILED:
            raise SystemExit(f"The fuzzer of {name} does not run: {said[-2000:]}")
    found = {
        **totals,
        "places": [places[0], max(places)],
        "corpus": len(list((folder / "corpus").iterdir())),
        "findings": _replayed(name, folder),
    }
    (folder / "figures.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    (folder / _STOPPED).unlink(missing_ok=True)
    return found


def _continued(folder: Path) -> tuple[dict[str, Any], list[int]]:
    """Totals and places of a call that was stopped, with those of its last process; nothing if there is none."""
    begun = dict.fromkeys((*_SUMS, "slowest_s", "peak_MB", "died"), 0)
    if not (folder / _STOPPED).exists():
        return begun, []
    kept = json.loads((folder / _STOPPED).read_text(encoding="utf-8"))
    if kept["sources"] != _sources():
        return begun, []
    _add(kept["totals"], folder / "worker.json")
    kept["totals"]["died"] += len(_ended_processes(folder)) - kept["ended"]
    return kept["totals"], kept["places"]


def _keep(folder: Path, totals: dict[str, Any], places: list[int]) -> None:
    """Leave the figures so far for a call that continues this one; those of the next process come beside them."""
    kept = {"totals": totals, "places": places, "ended": len(_ended_processes(folder)), "sources": _sources()}
    part = folder / f"{_STOPPED}.part"
    part.write_text(json.dumps(kept), encoding="utf-8")
    # Rather a lost process than one that counts twice.
    (folder / "worker.json").unlink(missing_ok=True)
    os.replace(part, folder / _STOPPED)


def _ended_processes(folder: Path) -> set[Path]:
    """Contents that ended the process of the fuzzer."""
    return set((folder / "findings").glob("native-*"))


@lru_cache
def _sources() -> str:
    """Hash of the program and of the fuzzer: figures of other code are not continued."""
    files = sorted([*(_ROOT / "sysid").rglob("*.py"), *Path(__file__).parent.glob("*.py")])
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def _run(name: str, folder: Path, options: tuple[str, ...]) -> str:
    command = [sys.executable, "-m", "studies.fuzz.worker", name, str(folder), *_OPTIONS, *options]
    said = _said(command)
    (folder / "last.log").write_text(said, encoding="utf-8")
    return said


def _said(command: list[str]) -> str:
    """What a process prints: the lines that count coverage, then the last ones.

    libFuzzer also prints contents, of megabytes each. If this process kept them, its memory would count as that of
    every process that it starts later, and these would stop at their limit at once.
    """
    counted: list[bytes] = []
    last: deque[bytes] = deque(maxlen=_LAST_LINES)
    with subprocess.Popen(command, cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert process.stdout is not None
        for line in iter(partial(process.stdout.readline, _LINE_BYTES), b""):
            (counted if _COVERAGE.match(line.decode("utf-8", "replace")) else last).append(line)
    return b"".join([*counted, *last]).decode("utf-8", "replace")


def _add(totals: dict[str, Any], file: Path) -> bool:
    """Whether a process left figures; they are added to the totals."""
    if not file.exists():
        return False
    for key, value in json.loads(file.read_text(encoding="utf-8")).items():
        if key in _SUMS:
            totals[key] = round(totals[key] + value, 1)
        elif key in totals:
            totals[key] = max(totals[key], value)
    return True


def _replayed(name: str, folder: Path) -> dict[str, Any]:
    """Every finding by its file, as the product ends on it."""
    files = sorted(p for p in (folder / "findings").iterdir() if p.suffix != ".txt")
    return {file.name: replay(name, file) for file in files}


def main(arguments: list[str] | None = None) -> None:
    """Fuzz and show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"readers, all without: {', '.join(TARGETS)}")
    parser.add_argument("--seconds", type=float, default=3600.0, help="for every reader")
    parser.add_argument("--jobs", type=int, default=2, help="readers at a time")
    parser.add_argument("--output", type=Path, default=Path("build/fuzz"), help="folder of contents and figures")
    parser.add_argument("--document", type=Path, default=None, help="file whose figures are rewritten")
    parser.add_argument("--tables-only", action="store_true", help="nothing is fuzzed")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.targets if name not in TARGETS]
    if unknown:
        parser.error(f"no reader '{unknown[0]}'; there are {', '.join(TARGETS)}")
    if not options.tables_only:
        _fuzz_all(options.targets or list(TARGETS), options)
    page = options.document.read_text(encoding="utf-8") if options.document is not None else ""
    found = table(options.output, page)
    sys.stdout.write(found + "\n")
    if options.document is not None:
        write_between_marks(options.document, "fuzz", found)


def _fuzz_all(names: list[str], options: argparse.Namespace) -> None:
    with ThreadPoolExecutor(options.jobs) as pool:
        every = pool.map(lambda name: fuzz(name, options.output.resolve() / name, options.seconds), names)
        for name, figures in zip(names, every, strict=True):
            wrong = {file: f["wrong"] for file, f in figures["findings"].items() if "wrong" in f}
            sys.stdout.write(f"{name}: {figures['inputs']} inputs, {len(wrong)} wrong\n")
            sys.stdout.writelines(f"    {file}: {text}\n" for file, text in wrong.items())
            sys.stdout.flush()


if __name__ == "__main__":
    main()
