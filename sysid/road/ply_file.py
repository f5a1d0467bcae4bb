"""Points of PLY files, read by plyfile: here if the header shows what it takes, in a child process otherwise."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass

import numpy as np

from sysid.bounded_reader import read_in_child
from sysid.errors import DataRejectedError
from sysid.road.cloud_libraries import read_ply
from sysid.road.las_file import check_count

#: Bytes in which the end of the header is looked for.
_HEAD_BYTES = 65536
_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r)?", re.MULTILINE)
_NAME = re.compile(r"[\w.\-]{1,100}", re.ASCII)
#: Size of a value of each type.
_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "float", "int32", "uint32", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
#: A comment about the unit, such as `comment units: mm`.
_UNIT = re.compile(r"^(?:comment|obj_info)\b.*\bunits?\b\W*(?:is|are)?\W*([A-Za-z]+)\s*$", re.MULTILINE | re.IGNORECASE)
_FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
#: Memory up to which a file whose needs are known is read in this process.
_SMALL_BYTES = 100_000_000


@dataclass(frozen=True)
class _Element:
    """One element of the header: its properties as (words of the type, name)."""

    name: str
    count: int
    properties: tuple[tuple[tuple[str, ...], str], ...]

    @property
    def row_bytes(self) -> int | None:
        """Bytes of one row in binary form, None where a list makes rows differ."""
        kinds = [kind for kind, _ in self.properties]
        return None if any(len(kind) > 1 for kind in kinds) else sum(_BYTES[kind[0]] for kind in kinds)


def ply_points(data: bytes, label: str, most_points: int) -> np.ndarray:
    """Coordinates (n, 3) float64 of the vertices of a PLY file, ASCII or binary, in its unit.

    Raises
    ------
    DataRejectedError
        If the header is damaged or announces more than the file holds, or there are no vertices with x, y and z or more
        than `most_points`.
    """
    kind, elements, body = _header(data, label)
    vertex = next((e for e in elements if e.name == "vertex"), None)
    if vertex is None:
        raise DataRejectedError(f"{label} is a PLY file without vertices; export the points.")
    promised = sum(e.count for e in elements)
    if promised > len(data):
        raise DataRejectedError(
            f"{label} announces {promised} PLY elements but has only {len(data)} bytes; export it again."
        )
    check_count(label, vertex.count, most_points)
    names = {name.lower(): name for _, name in vertex.properties}
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise DataRejectedError(f"{label}: the PLY vertices have no property {', '.join(missing)}; export x, y and z.")
    # The library sees the header as it was understood here: nothing in it can mean more to one than to the other.
    content = b"".join((_written(kind, elements), memoryview(data)[body:]))
    request = {"names": [names[axis] for axis in "xyz"]}
    if not _small(kind, elements, len(data) - body):
        answer, arrays = read_in_child(read_ply, content, label, ["plyfile"], **request)
        if "error" in answer:
            raise _unreadable(label, answer.get("text") or answer["error"])
        return arrays[0]
    try:
        return read_ply(io.BytesIO(content), request)[1][0]
    # The parser meets arbitrary bytes: whatever it stumbles over means the same to the user.
    except Exception as error:
        raise _unreadable(label, str(error) or type(error).__name__) from error


def ply_unit(data: bytes) -> str | None:
    """The unit that a comment in the header names, None without one."""
    end = _END.search(data[:_HEAD_BYTES])
    match = _UNIT.search(data[: end.start() if end is not None else 0].decode("ascii", errors="replace"))
    return match[1] if match is not None else None


def _header(data: bytes, label: str) -> tuple[str, tuple[_Element, ...], int]:
    """Format, elements, and where the rows begin."""
    end = _END.search(data[:_HEAD_BYTES])
    if end is None:
        raise DataRejectedError(f"{label} is a PLY file without the end of its header; export it again.")
    kind, elements = "", list[tuple[str, int, list[tuple[tuple[str, ...], str]]]]()
    for line in re.split(r"[\r\n]+", data[: end.start()].decode("ascii", errors="replace"))[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _FORMATS:
            kind = words[1]
        elif words[0] == "element" and len(words) == 3 and _NAME.fullmatch(words[1]) and words[2].isdecimal():
            # Long digits are cut: what is left is far more than any file holds.
            elements.append((words[1], int(words[2].lstrip("0")[:18] or "0"), []))
        elif _is_property(words) and elements:
            elements[-1][2].append((tuple(words[1:-1]), words[-1]))
        else:
            raise _unreadable(label, f"its header has the line '{line.strip()[:60]}'")
    if not kind:
        raise _unreadable(label, "its header names no known format")
    return kind, tuple(_Element(name, count, tuple(found)) for name, count, found in elements), end.end()


def _is_property(words: list[str]) -> bool:
    if words[0] != "property" or not _NAME.fullmatch(words[-1]):
        return False
    kinds = words[1:-1]
    return (len(kinds) == 1 and kinds[0] in _BYTES) or (
        len(kinds) == 3 and kinds[0] == "list" and kinds[1] in _BYTES and kinds[2] in _BYTES
    )


def _written(kind: str, elements: tuple[_Element, ...]) -> bytes:
    lines = ["ply", f"format {kind} 1.0"]
    for element in elements:
        lines.append(f"element {element.name} {element.count}")
        lines += [f"property {' '.join(words)} {name}" for words, name in element.properties]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _small(kind: str, elements: tuple[_Element, ...], body_bytes: int) -> bool:
    """Whether the memory that reading takes follows from the header, is little, and the file can hold so much."""
    rows = [e.row_bytes for e in elements]
    if any(row is None for row in rows):
        return False
    stored = sum(e.count * (row or 0) for e, row in zip(elements, rows, strict=True))
    least = sum(2 * e.count * len(e.properties) for e in elements) if kind == "ascii" else stored
    return stored <= _SMALL_BYTES and least <= body_bytes + 1


def _unreadable(label: str, reason: str) -> DataRejectedError:
    first = reason.strip().partition("\n")[0][:160]
    return DataRejectedError(f"{label} is not a readable PLY file ({first}); export it again.")
