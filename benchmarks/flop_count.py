"""Floating-point operations of a likelihood, counted by the engine's own sources with packs that count.

The time loop is a template of its numbers.  Its sources are copied, the vectors that they compute with are replaced by
a class that does the same and counts (``bare/count/counted.h``), and the bare kernel is compiled from the copy.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.bare_kernel import compile_sources
from sysid.vehicle_model.native import build

_SOURCES = Path(build.__file__).parent
_COUNTED = Path(__file__).parent / "bare" / "count" / "counted.h"
#: What is replaced in the sources: file, pattern and replacement; every pattern is found once.
_REPLACED = (
    ("pack.h", r"typedef double Pack [^\n]*\n", ""),
    ("pack.h", r"inline Pack splat\(double x\)[^\n]*\n", '}  // namespace\n#include "counted.h"\nnamespace sysid {\n'),
    ("pack.h", r"inline Pack select\(Mask where, Pack yes, Pack no\)[^\n]*\n", ""),
    ("pack.h", r"inline Pack square_root\(Pack x\) \{.*?\n\}\n", ""),
    ("pack.h", r"constexpr __mmask8 kEvery.*?\n#endif\n", "#endif\n"),
    ("contact.h", r"typedef double MapRow [^\n]*\n", ""),
)


class Operations(NamedTuple):
    """Operations of one set: of its own, and its share of the road's, which is looked up once for a pack of sets."""

    additions: float
    multiplications: float
    divisions: float
    roots: float
    others: float
    road: float

    @property
    def floating(self) -> float:
        """Floating-point operations; comparisons, selections, signs and bits are none."""
        return self.additions + self.multiplications + self.divisions + self.roots + self.road


def copied_sources(folder: Path, replaced: Sequence[tuple[str, str, str]] = (), *, patterns: bool = False) -> Path:
    """A copy of the engine's sources with some texts replaced.

    Raises
    ------
    ValueError
        If a text is not found exactly once.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in build.SOURCES:
        shutil.copyfile(_SOURCES / name, folder / name)
    for name, old, new in replaced:
        pattern = old if patterns else re.escape(old)
        text = (folder / name).read_text(encoding="utf-8")
        changed, found = re.subn(pattern, lambda _, new=new: new, text, flags=re.DOTALL)
        if found != 1:
            raise ValueError(f"{name} has {found} places like {old!r}, expected one: adapt the benchmark")
        (folder / name).write_text(changed, encoding="utf-8")
    return folder


def counting_program(folder: Path) -> Path:
    """The bare kernel compiled to count; its answers end with the numbers of operations.

    Raises
    ------
    ValueError
        If the sources are no longer those that the replacements were written for.
    BuildError
        If there is no compiler or it fails.
    """
    copy = copied_sources(folder / "counting", _REPLACED, patterns=True)
    shutil.copyfile(_COUNTED, copy / _COUNTED.name)
    return compile_sources(folder / "counting_kernel", copy, ("-DSYSID_COUNTED",))


def count(program: Path, call: Path, sets: int) -> Operations:
    """Operations of each of so many sets in a call."""
    done = subprocess.run(
        [str(program), str(call)],
        input="0 1\n",
        capture_output=True,
        text=True,
        check=True,
        # The counters are shared by all threads and not locked.
        env=os.environ | {"SYSID_THREADS": "1"},
    )
    counts = [int(text) for text in done.stdout.split()[3:]]
    lanes = int(done.stdout.split()[3:][-1])
    own = [lanes * value / sets for value in counts[:5]]
    return Operations(*own, sum(counts[5:9]) / sets)
