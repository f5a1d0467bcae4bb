"""The way of `calibrate.py fit` through the code: which files a reader of the calls passes, and how often again.

    python -m studies.walk CAMPAIGN [--root ROOT] [--below FUNCTION] [--first N]

ROOT is a checkout, by default this one, so that an earlier state can be measured by the same command.  A function is a
stop where a function of the package calls it for the first time; functions that other libraries call (compiled code,
callbacks of solvers), functions without a name and what modules call while they are imported are left out.  Stops in
the same file one after the other count once; a stop in a file that was left before is a return.  With `--below` only
what that function calls is counted, directly or through others.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import CodeType, FrameType
from typing import Any


def _callers(frame: FrameType) -> Iterator[FrameType]:
    caller = frame.f_back
    while caller is not None:
        yield caller
        caller = caller.f_back


def stops(run: Callable[[], object], folder: Path, below: str | None = None) -> list[str]:
    """Files in `folder`, relative to it, in the order in which their functions are called for the first time."""
    start = f"{folder.resolve()}/"
    called: dict[int, CodeType] = {}

    def inside(frame: FrameType | None) -> bool:
        return frame is not None and frame.f_code.co_filename.startswith(start)

    def watch(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or id(code) in called or code.co_name.startswith("<"):
            return
        if not inside(frame) or not inside(frame.f_back):
            return
        names = {caller.f_code.co_name for caller in _callers(frame) if inside(caller)}
        if "<module>" not in names and (below is None or below in names):
            called[id(code)] = code

    sys.setprofile(watch)
    try:
        run()
    finally:
        sys.setprofile(None)
    return [code.co_filename.removeprefix(start) for code in called.values()]


def path(places: Sequence[str]) -> list[str]:
    """Places in a row, those that stand one after the other once."""
    return [place for i, place in enumerate(places) if not i or place != places[i - 1]]


def counts(places: Sequence[str], what: str) -> str:
    """Stops, distinct places and returns in words."""
    walked = path(places)
    return f"{what}: {len(walked)} stops, {len(set(walked))} distinct, {len(walked) - len(set(walked))} returns"


def report(files: Sequence[str], first: int) -> list[str]:
    """The figures and the beginning of the path as lines of text."""
    packages = [str(Path(file).parent) for file in files]
    return [
        f"functions: {len(files)}",
        counts(files, "files"),
        counts(packages, "packages"),
        *(f"  {i + 1:3d} {file}" for i, file in enumerate(path(files)[:first])),
    ]


def fit(root: Path, campaign: Path, below: str | None) -> list[str]:
    """Stops of a quick fit of a campaign by the checkout at `root`."""
    sys.path.insert(0, str(root.resolve()))
    from sysid.cli.main import cli

    def run() -> None:
        with tempfile.TemporaryDirectory() as output, suppress(SystemExit):
            cli(["fit", str(campaign), "--quick", "--output", str(Path(output, "output"))])

    return stops(run, root / "sysid", below)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--root", type=Path, default=Path())
    parser.add_argument("--below", help="count only what this function calls")
    parser.add_argument("--first", type=int, default=40, help="how many stops of the path are printed")
    given = parser.parse_args()
    sys.stdout.write("\n".join(report(fit(given.root, given.campaign, given.below), given.first)) + "\n")
