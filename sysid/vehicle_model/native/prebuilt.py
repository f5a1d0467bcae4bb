"""The engine that a wheel carries, compiled beforehand: which build this processor can run, and whether it is whole."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from sysid.private_files import NotPrivateError, check_as_private_as
from sysid.vehicle_model.native import processor
from sysid.vehicle_model.native.build import BuildError, source_digest

#: Where a wheel has its builds; in a checkout there are none.
FOLDER = Path(__file__).parent / "builds"
LIST = "builds.json"

_SSE = {"pni", "ssse3", "sse4_1", "sse4_2", "popcnt", "cx16", "lahf_lm"}
# abm: lzcnt
_V3 = frozenset(_SSE | {"avx", "avx2", "fma", "f16c", "bmi1", "bmi2", "abm", "movbe", "xsave"})
_V4 = _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
#: Instruction sets that a build uses, the fastest build first: levels of the x86-64 psABI under the names that Linux
#: gives their parts, and what any processor of the wheel's architecture runs.
NEEDS = {"x86-64-v4": _V4, "x86-64-v3": _V3, "generic": frozenset[str]()}


def library() -> tuple[str, Path]:
    """Name and file of the fastest build in this installation that the processor can run.

    The list of builds beside them holds the hash of the sources that they were made from and the sha256 of each.

    Raises
    ------
    BuildError
        If there is none, it was made from other sources, is damaged, or is open to people to whom the program's code is
        not.
    """
    if not (FOLDER / LIST).is_file():
        raise BuildError("this installation carries no prebuilt engine")
    try:
        listed = json.loads(_content(FOLDER / LIST))
        name = _fastest(listed["builds"])
        content = _content(FOLDER / f"{name}.so")
    except (NotPrivateError, OSError, ValueError, KeyError, TypeError) as error:
        raise BuildError(f"the prebuilt engine cannot be read ({error})") from error
    if listed.get("sources") != source_digest():
        raise BuildError("the prebuilt engine was made from other sources than those of this version")
    if hashlib.sha256(content).hexdigest() != listed["builds"][name]:
        raise BuildError(f"the prebuilt engine {FOLDER / name}.so is not the file that was packed; install sysid again")
    return name, FOLDER / f"{name}.so"


def _fastest(builds: dict[str, Any]) -> str:
    able = processor.flags()
    for name, needed in NEEDS.items():
        if name in builds and needed <= able:
            return name
    raise BuildError("the prebuilt engine needs a processor with AVX2 and FMA")


def _content(file: Path) -> bytes:
    check_as_private_as(Path(__file__), file)
    return file.read_bytes()
