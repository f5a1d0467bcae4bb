"""One process of the fuzzer, for one reader: started by `studies.fuzz`, ended by libFuzzer.

    python -m studies.fuzz.worker TARGET FOLDER [OPTIONS OF LIBFUZZER]

Every content ends in a result or in one sentence.  Anything else goes to FOLDER/findings, one file for each place in
the code, and the fuzzer goes on.  Figures are kept in FOLDER/worker.json, so that they survive a process that dies.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import os
import random
import resource
import signal
import sys
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from studies.fuzz.targets import TARGETS, Target

#: Processor time that a content may take, and after which a reader of the child process is stopped here [s]; the
#: limits of the product itself are longer, and what is stopped here is read once more with those.
MOST_SECONDS, CHILD_SECONDS = 10.0, 3.0
#: One content in so many is stretched, up to this size.
STRETCHED_EVERY = 3000
MOST_CONTENT = 10_000_000


class StoppedError(BaseException):
    """A reader took too long; no handler for errors takes it."""


class Worker:
    """Reads contents and keeps what was found."""

    def __init__(self, target: Target, folder: Path, instrument: Any) -> None:
        self.folder, self.findings = folder, folder / "findings"
        self.findings.mkdir(exist_ok=True)
        self.figures: dict[str, Any] = {"inputs": 0, "refused": 0, "stopped": 0, "slowest_s": 0.0, "largest": 0}
        self.limit_s = CHILD_SECONDS if target.in_child else MOST_SECONDS
        self._written = 0.0
        with instrument(include=["sysid", "support", "hostile_files", *target.watched]):
            import sysid.campaign
            import sysid.road.profile_files
            import sysid.workflow.store  # noqa: F401

            for module in target.loaded:
                importlib.import_module(module)
            self.read = target.reader()
        from sysid.errors import SysidError

        self.sentence = SysidError
        if target.in_child:
            _read_in_this_process()

    def __call__(self, content: bytes) -> None:
        """What libFuzzer calls."""
        began = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, self.limit_s)
        try:
            self.read(self.folder / "place", content)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        except self.sentence as error:
            self.figures["refused"] += 1
            text = str(error)
            if "\n" in text or len(text) > 1000 or not text.endswith((".", "?")):
                self.keep("words", content, text)
        except StoppedError as stopped:
            self.figures["stopped"] += 1
            self.keep("slow", content, "".join(traceback.format_exception(stopped)[-4:]))
        except Exception as error:
            self.keep("error", content, "".join(traceback.format_exception(error)[-6:]))
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        self.count(time.process_time() - began, len(content))

    def count(self, seconds: float, size: int) -> None:
        """Add one content to the figures."""
        self.figures["inputs"] += 1
        self.figures["slowest_s"] = round(max(self.figures["slowest_s"], seconds), 2)
        self.figures["largest"] = max(self.figures["largest"], size)
        now = time.monotonic()
        if now - self._written > 1.0:
            self._written = now
            self.figures["processor_s"] = round(time.process_time(), 1)
            self.figures["peak_MB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6)
            part = self.folder / "worker.part"
            part.write_text(json.dumps(self.figures), encoding="utf-8")
            os.replace(part, self.folder / "worker.json")

    def keep(self, kind: str, content: bytes, words: str) -> None:
        """Keep the first content of every place in the code."""
        place = hashlib.sha256(_place(kind, words).encode()).hexdigest()[:12]
        path = self.findings / f"{kind}-{place}"
        if not path.exists():
            path.write_bytes(content)
            path.with_suffix(".txt").write_text(words, encoding="utf-8")


def _place(kind: str, words: str) -> str:
    if kind == "words":
        return kind
    return "|".join(line.strip() for line in words.splitlines() if line.startswith('  File "'))


def _read_in_this_process() -> None:
    """Readers of the child process run here, and what they end in is handed on as the child hands it on."""
    from sysid import limits
    from sysid.errors import DataRejectedError
    from sysid.read_worker import limit_process

    limit_process(limits.READER_BYTES, 10 * 3600.0)

    def here(
        function: Any, data: bytes, label: str, libraries: Any, **request: Any
    ) -> tuple[dict[str, Any], list[np.ndarray]]:
        try:
            answer, arrays = function(io.BytesIO(data), request)
        except MemoryError:
            raise DataRejectedError(f"{label} takes too much memory.") from None
        except (KeyboardInterrupt, SystemExit, StoppedError):
            raise
        except BaseException as error:
            answer, arrays = {"error": type(error).__name__, "text": str(error)[:1000]}, []
        return dict(json.loads(json.dumps(answer))), arrays

    for name in ("sysid.road.profile_files", "sysid.road.ply_file", "sysid.road.las_file", "sysid.logs.by_library"):
        importlib.import_module(name).read_in_child = here  # type: ignore[attr-defined]


def changed(mutate: Any, content: bytes, most: int, seed: int) -> bytes:
    """What libFuzzer makes of a content; now and then a stretch of it is repeated up to megabytes."""
    rng = random.Random(seed)
    if content and rng.randrange(STRETCHED_EVERY) == 0:
        at = rng.randrange(len(content))
        piece = content[at : at + rng.choice((1, 20, 300, 5000))]
        times = rng.randrange(1, min(most, MOST_CONTENT) // max(len(piece), 1) + 1)
        return (content[:at] + piece * times + content[at:])[:most]
    return bytes(mutate(content, most))


def main() -> None:
    """Fuzz until libFuzzer ends."""
    import atheris

    name, folder, *options = sys.argv[1:]
    warnings.simplefilter("ignore")
    place = Path(folder) / "place"
    place.mkdir(exist_ok=True)
    worker = Worker(TARGETS[name], Path(folder), atheris.instrument_imports)

    def stop(number: int, frame: object) -> None:
        raise StoppedError

    signal.signal(signal.SIGPROF, stop)

    def mutated(content: bytes, most: int, seed: int) -> bytes:
        # Looked up when it is called: before the fuzzer runs the name stands for another function.
        return changed(atheris.Mutate, content, most, seed)

    atheris.Setup([sys.argv[0], *options], worker, custom_mutator=mutated)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
