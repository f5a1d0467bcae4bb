"""Points of PLY files, ASCII or binary, read by NumPy as their header says."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from itertools import islice

import numpy as np

from sysid.errors import DataRejectedError
from sysid.road.las_file import check_count

#: Bytes in which the end of the header is looked for.
_HEAD_BYTES = 65536
_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r)?", re.MULTILINE)
_NAME = re.compile(r"[\w.\-]{1,100}", re.ASCII)
#: NumPy's name of each type, less the order of its bytes.
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
#: A comment about the unit, such as `comment units: mm`.
_UNIT = re.compile(r"^(?:comment|obj_info)\b.*\bunits?\b\W*(?:is|are)?\W*([A-Za-z]+)\s*$", re.MULTILINE | re.IGNORECASE)
#: Types that the length of a list can have.
_LENGTHS = frozenset(word for word, name in _TYPES.items() if "f" not in name)
#: Order of the bytes in each format.
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Numbers of a text that are held at a time, and rows with lists before the vertices that are walked through.
_BLOCK_NUMBERS = 1_000_000
_MOST_LISTS = 1_000_000


@dataclass(frozen=True)
class _Element:
    """One element of the header: its properties as (words of the type, name)."""

    name: str
    count: int
    properties: tuple[tuple[tuple[str, ...], str], ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(len(words) > 1 for words, _ in self.properties)

    def row(self, order: str) -> np.dtype[np.void]:
        """One row in binary form, of an element without lists."""
        return np.dtype([(f"p{i}", order + _TYPES[words[0]]) for i, (words, _) in enumerate(self.properties)])


def ply_points(data: bytes, label: str, most_points: int) -> np.ndarray:
    """Coordinates (n, 3) float64 of the vertices of a PLY file, ASCII or binary, in its unit.

    Format as described by G. Turk, The PLY Polygon File Format (1994).

    Raises
    ------
    DataRejectedError
        If the header is damaged or announces more than the file holds, or there are no vertices with x, y and z or more
        than `most_points`.
    """
    kind, elements, begin = _header(data, label)
    at = next((i for i, e in enumerate(elements) if e.name == "vertex"), None)
    if at is None:
        raise DataRejectedError(f"{label} is a PLY file without vertices; export the points.")
    vertex, before = elements[at], elements[:at]
    promised = sum(e.count for e in elements)
    if promised > len(data):
        raise DataRejectedError(
            f"{label} announces {promised} PLY elements but has only {len(data)} bytes; export it again."
        )
    check_count(label, vertex.count, most_points)
    names = [name.lower() for _, name in vertex.properties]
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise DataRejectedError(f"{label}: the PLY vertices have no property {', '.join(missing)}; export x, y and z.")
    if any(names.count(axis) > 1 for axis in "xyz"):
        raise _unreadable(label, "its vertices have x, y or z twice")
    if vertex.has_lists:
        raise _unreadable(label, "its vertices have lists of values")
    columns = [names.index(axis) for axis in "xyz"]
    if kind == "ascii":
        return _text_rows(data[begin:], vertex, sum(e.count for e in before), columns, label)
    for element in before:
        begin = _end_of(element, data, begin, _FORMATS[kind], label)
    row = vertex.row(_FORMATS[kind])
    if begin + vertex.count * row.itemsize > len(data):
        raise _unreadable(label, "it ends before its last vertex")
    rows = np.frombuffer(data, row, vertex.count, begin)
    return np.column_stack([rows[f"p{i}"].astype(np.float64) for i in columns])


def _text_rows(body: bytes, vertex: _Element, skipped: int, columns: list[int], label: str) -> np.ndarray:
    lines = islice(io.TextIOWrapper(io.BytesIO(body), "ascii", "replace"), skipped, skipped + vertex.count)
    width = len(vertex.properties)
    blocks: list[np.ndarray] = []
    while block := list(islice(lines, max(1, _BLOCK_NUMBERS // width))):
        try:
            # Of a block of empty lines alone NumPy would warn.
            rows = np.loadtxt(block, comments=None, ndmin=2) if block[0].strip() else np.empty((0, 0))
        except ValueError:
            rows = np.empty((0, 0))
        if rows.shape != (len(block), width):
            raise _unreadable(label, f"not every vertex has {width} numbers in a line of its own")
        blocks.append(rows[:, columns])
    if sum(len(b) for b in blocks) < vertex.count:
        raise _unreadable(label, "it ends before its last vertex")
    return np.concatenate(blocks)


def _end_of(element: _Element, data: bytes, place: int, order: str, label: str) -> int:
    """Where the rows of an element end that begin at `place`."""
    if not element.has_lists:
        return place + element.count * element.row(order).itemsize
    if element.count > _MOST_LISTS:
        raise _unreadable(label, f"its vertices stand behind {element.count} lists")
    types = [[np.dtype(order + _TYPES[word]) for word in words[-2:]] for words, _ in element.properties]
    for _ in range(element.count):
        for value, *listed in types:
            if listed:
                raw = data[place : place + value.itemsize]
                length = int(np.frombuffer(raw, value)[0]) if len(raw) == value.itemsize else -1
                if length < 0:
                    raise _unreadable(label, f"its element {element.name} has a list without a length")
                place += length * listed[0].itemsize
            place += value.itemsize
    return place


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
    return (len(kinds) == 1 and kinds[0] in _TYPES) or (
        len(kinds) == 3 and kinds[0] == "list" and kinds[1] in _LENGTHS and kinds[2] in _TYPES
    )


def _unreadable(label: str, reason: str) -> DataRejectedError:
    first = reason.strip().partition("\n")[0][:160]
    return DataRejectedError(f"{label} is not a readable PLY file ({first}); export it again.")
