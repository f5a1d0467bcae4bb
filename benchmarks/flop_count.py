"""Floating-point operations of a likelihood, counted by the engine's own sources with packs that count.

The time loop is a template of its numbers.  Its sources are copied, the vectors that they compute with are replaced by a
class that does the same and counts (``bare/count/counted.h``), and the bare kernel is compiled from the copy.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

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
    ("contact.h", r"typedef double MapRow [^\n]*\n", ""),
)


def counting_program(folder: Path) -> Path:
    """The bare kernel compiled to count; it prints the numbers of operations when its input ends.

    Raises
    ------
    ValueError
        If the sources are no longer those that the replacements were written for.
    """
    copy = folder / "counting"
    copy.mkdir(parents=True, exist_ok=True)
    for name in build.SOURCES:
        shutil.copyfile(_SOURCES / name, copy / name)
    shutil.copyfile(_COUNTED, copy / _COUNTED.name)
    for name, pattern, replacement in _REPLACED:
        text, found = re.subn(pattern, lambda _, r=replacement: r, (copy / name).read_text("utf-8"), flags=re.S)
        if found != 1:
            raise ValueError(f"{name} has {found} places like {pattern!r}, expected one: adapt flop_count.py")
        (copy / name).write_text(text, encoding="utf-8")
    return compile_sources(folder / "counting_kernel", copy, ("-DSYSID_COUNTED",))
