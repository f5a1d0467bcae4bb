"""The C++ header of the description in :mod:`sysid.vehicle_model.native.buffers`: constants, settings, arrays, rows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from sysid.vehicle_model.native.buffers import (
    BLOCKS,
    CONSTANTS,
    ENTRIES,
    LAW_ROWS,
    NO_MEMORY,
    SETTINGS,
    Buffer,
    law_rows,
)
from sysid.vehicle_model.suspension import ELEMENT_FIELDS

NAME = "buffers.h"


def fingerprint() -> str:
    """Short hash of the description: the library says with which it was compiled."""
    return hashlib.sha256(_body().encode("utf-8")).hexdigest()[:16]


def header() -> str:
    """Text of the header."""
    return (
        "// Made from sysid/vehicle_model/native/buffers.py when the engine is compiled: change that file instead.\n\n"
        f"#pragma once\n\n#include <cstdint>\n\nnamespace sysid {{\n\n{_body()}\n"
        f'inline constexpr char kFingerprint[] = "{fingerprint()}";\n\n}}  // namespace sysid\n'
    )


def write(folder: Path) -> Path:
    """Write the header into a folder for the compiler's ``-I``."""
    file = folder / NAME
    file.write_text(header(), encoding="utf-8")
    return file


def _body() -> str:
    parts = [
        *(f"constexpr {'int' if isinstance(v, int) else 'double'} {name} = {v!r};" for name, v in CONSTANTS.items()),
        f'inline constexpr char kNoMemory[] = "{NO_MEMORY}";',
        "",
        _settings(),
        "// Arrays that entry points take, block by block.",
        *(_enumeration(f"{_camel(name)}Buffer", buffers, f"k{_camel(name)}Count") for name, buffers in BLOCKS.items()),
        "// Where the blocks of an entry point begin, and how many arrays it takes.",
        *_places(),
        "// What entry points return.",
        *(_enumeration(f"{_camel(n)}Result", e.results, f"k{_camel(n)}Results", _camel(n)) for n, e in ENTRIES.items()),
        _elements(),
        _coefficients(),
    ]
    return "\n".join(parts) + "\n"


def _settings() -> str:
    names = {int: "int64_t", float: "double", list: "AxleList"}
    members = "\n".join(f"  {names[kind]} {name};" for name, kind in SETTINGS.items())
    return (
        "// Some axles.\nstruct AxleList {\n  const int64_t* at;\n  int64_t count;\n};\n\n"
        f"// What a call says beside its arrays.\nstruct Settings {{\n{members}\n}};\n"
    )


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _enumeration(name: str, buffers: Iterable[Buffer], count: str, prefix: str = "") -> str:
    lines = [
        f"  k{prefix}{_camel(b.name)},  // ({', '.join(map(str, b.shape))}) {b.meaning}{' (or empty)' * b.optional}"
        for b in buffers
    ]
    return "\n".join([f"enum {name} {{", *lines, f"  {count}", "};", ""])


def _places() -> list[str]:
    lines = []
    for name, entry in ENTRIES.items():
        before = "0"
        for block in entry.blocks:
            lines.append(f"constexpr int k{_camel(name)}{_camel(block)} = {before};")
            before = f"k{_camel(name)}{_camel(block)} + k{_camel(block)}Count"
        lines.append(f"constexpr int k{_camel(name)}Count = {before};")
    return [*lines, ""]


def _elements() -> str:
    members = "\n".join(f"  bool {name} = false;" for name in ELEMENT_FIELDS)
    bits = "\n".join(f"    {name} = (bits & {1 << bit}) != 0;" for bit, name in enumerate(ELEMENT_FIELDS))
    return (
        "// Elements of suspension laws that some axle has.\n"
        f"struct SmoothElements {{\n{members}\n  void set(int64_t bits) {{\n{bits}\n  }}\n"
        f"  bool any() const {{ return {' || '.join(ELEMENT_FIELDS)}; }}\n}};\n"
    )


def _coefficients() -> str:
    members = "\n".join(f"  V {name}{{}};" for name in law_rows(tuple(ELEMENT_FIELDS)))
    lines = [f"  c.{name} = next();" for name in LAW_ROWS]
    for name, fields in ELEMENT_FIELDS.items():
        lines += [f"  if (has.{name}) {{", *(f"    c.{field} = next();" for field in fields), "  }"]
    return (
        "// Coefficients of one axle's laws, and how they are read from the rows of `laws`.\n"
        f"template <class V>\nstruct Coefficients {{\n{members}\n}};\n\n"
        "template <class V, class Next>\n"
        "Coefficients<V> read_coefficients(const SmoothElements& has, Next&& next) {\n  Coefficients<V> c;\n"
        + "\n".join(lines)
        + "\n  return c;\n}\n"
    )
