"""Point clouds in text files: delimiter, decimal sign and columns are found by looking at the first lines."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError
from sysid.logs.text_numbers import (
    MISSING,
    WHITE_SPACE,
    CellError,
    LongRowError,
    NumberTable,
    count_rows,
    encoding_of,
    head_lines,
    read_numbers,
)

#: Bytes in which the layout is looked for, and longest line.
_HEAD_BYTES = 65536
#: Lines of comment that may stand between the points.
_COMMENT_LINES = 1000
_AXIS = re.compile(r"^([xyz])[\s_\[(]*([a-zµ]*)[\])]*$")
_UNIT_ALIASES = {"inch": "in", "inches": "in", "feet": "ft", "metre": "m", "meter": "m", "metres": "m", "meters": "m"}


@dataclass(frozen=True)
class _Layout:
    """How the file is written: encoding, delimiter (a pattern), decimal sign, lines before the data, columns of xyz."""

    encoding: str
    delimiter: str
    decimal: str
    skip_lines: int
    columns: tuple[int, int, int]
    names: tuple[str, str, str]
    width: int


def read_text_cloud(data: bytes, label: str, unit: str, max_points: int) -> np.ndarray:
    """Read x, y, z of a text file as (n, 3) float64 in the unit of the file, NaN where a cell is missing.

    `data` is its content, `label` begins every sentence about it; `unit` is only compared with units in the header
    (``x_mm``).  Raises DataRejectedError with file, row and remedy.
    """
    layout = _find_layout(data, label, unit)
    table = NumberTable(
        data=data,
        label=label,
        encoding=layout.encoding,
        delimiter=layout.delimiter,
        decimal=layout.decimal,
        skip_lines=layout.skip_lines,
        names=tuple(str(i) for i in range(layout.width)),
        blank_rows=False,
        strict=True,
        line_length=_HEAD_BYTES,
        most_rows=max_points + _COMMENT_LINES,
    )
    try:
        rows, width = count_rows(table)
        used = [place for place in layout.columns if place < width]
        columns = read_numbers(table, {place: str(place) for place in used}, rows, width)
    except LongRowError as error:
        raise DataRejectedError(
            f"{label}, line {error.number}: {error.cells} columns where {layout.width} are expected; correct that line."
        ) from None
    except CellError as error:
        name = layout.names[layout.columns.index(error.place)]
        raise DataRejectedError(
            f"{label}, column {name}, data row {error.row + 1}: {error.text[:40]!r} is not a number; correct that row "
            "or remove it."
        ) from None
    except UnicodeDecodeError:
        raise DataRejectedError(
            f"{label} holds bytes that are not text; export it as UTF-8 text, PLY or LAS."
        ) from None
    count = len(next(iter(columns.values()))) if columns else 0
    if count > max_points:
        raise DataRejectedError(
            f"{label} has more than {max_points} points; crop the cloud to a few metres around the bump or thin it."
        )
    points = np.full((count, 3), np.nan)
    for axis, place in enumerate(layout.columns):
        # A column is deleted as soon as it is copied: a large cloud must not be in memory twice.
        if (values := columns.pop(str(place), None)) is not None:
            points[:, axis] = values
    return points


def _find_layout(data: bytes, label: str, unit: str) -> _Layout:
    encoding, lines = _head_lines(data, label)
    header: str | None = None
    for index, line in enumerate(lines):
        stripped = line.strip().lstrip("\ufeff")
        if not stripped:
            continue
        # CloudCompare writes its header as a comment: "//X,Y,Z,Intensity".
        comment = stripped.startswith(("#", "//", ";", "%"))
        content = stripped.lstrip("#/;% ") if comment else stripped
        cells = [cell.strip().strip("\"'").lower() for cell in re.split(r"[,;\t]|\s+", content) if cell.strip()]
        if len(cells) > limits.CLOUD_COLUMNS:
            raise DataRejectedError(f"{label} has more than {limits.CLOUD_COLUMNS} columns; export only x, y and z.")
        if any(_AXIS.match(cell) for cell in cells):
            if header is None:
                header = content
            continue
        if comment or (header is None and len(cells) == 1 and cells[0].isdigit()):
            # PTS files start with the number of points on a line of its own.
            continue
        if not re.match(r"^[+-]?[\d.,]", stripped) and header is None and cells[0] not in MISSING:
            raise DataRejectedError(
                f"{label}, line {index + 1}: '{stripped[:60]}' is neither numbers nor a header "
                "naming x, y and z; write a header x_m,y_m,z_m or plain columns x y z."
            )
        return _layout_of(label, unit, encoding, header, stripped, index)
    raise DataRejectedError(f"{label} holds no rows of numbers; check the export of the scanner.")


def _layout_of(label: str, unit: str, encoding: str, header_line: str | None, first: str, skip: int) -> _Layout:
    delimiter = _delimiter(first)
    cells = _split(first, delimiter)
    header = None
    if header_line is not None:
        # "X [m],Y [m]": the data tell better than the header what stands between its names.
        header = _split(header_line, delimiter if delimiter in header_line else _delimiter(header_line))
    width = len(cells)
    if header is not None and delimiter == "," and width == 2 * len(header):
        raise DataRejectedError(
            f"{label}, line {skip + 1}: comma both between and inside the numbers; "
            "export with a decimal point or with semicolons between the columns."
        )
    if header is not None and len([cell for cell in cells if cell]) > len(header):
        raise DataRejectedError(
            f"{label}, line {skip + 1}: {width} columns under a header of {len(header)}; name every column."
        )
    width = max(width, len(header or ()))
    if width < 3:
        raise DataRejectedError(
            f"{label}, line {skip + 1}: '{first[:60]}' has {width} columns; x, y and z are expected."
        )
    decimal = "," if delimiter != "," and any("," in cell for cell in cells) else "."
    if header is None:
        columns, names = (0, 1, 2), ("x", "y", "z")
    else:
        columns, names = _columns_of(label, unit, header)
    return _Layout(encoding, delimiter, decimal, skip, columns, names, width)


def _columns_of(label: str, unit: str, header: list[str]) -> tuple[tuple[int, int, int], tuple[str, str, str]]:
    columns: dict[str, int] = {}
    for index, cell in enumerate(header):
        match = _AXIS.match(cell.strip().strip("\"'").lower())
        if match is None:
            continue
        axis, named_unit = match.group(1), _UNIT_ALIASES.get(match.group(2), match.group(2))
        if axis in columns:
            raise DataRejectedError(
                f"{label}: columns '{header[columns[axis]]}' and '{cell}' both name {axis}; keep one of them."
            )
        if named_unit and named_unit != _UNIT_ALIASES.get(unit, unit):
            raise DataRejectedError(
                f"{label}: column '{cell}' is in {named_unit} but the campaign file says unit = '{unit}'; "
                "make them agree."
            )
        columns[axis] = index
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise DataRejectedError(
            f"{label}: no column {' and '.join(missing)} in the header ({', '.join(header)[:80]}); "
            "name the columns x_m, y_m and z_m."
        )
    x, y, z = (columns[axis] for axis in "xyz")
    return (x, y, z), (header[x], header[y], header[z])


def _head_lines(data: bytes, label: str) -> tuple[str, list[str]]:
    """Return the encoding and the first complete lines."""
    # Names of extra columns are often in the scanner's own code page; numbers are the same in all of them.
    encoding = encoding_of(data[:_HEAD_BYTES])
    if "16" not in encoding and b"\x00" in data[:_HEAD_BYTES]:
        raise DataRejectedError(
            f"{label} is neither text nor PLY nor LAS (it holds zero bytes); export the cloud as CSV, XYZ, PLY or LAS."
        )
    lines = head_lines(data, encoding, _HEAD_BYTES)
    if len(data) > _HEAD_BYTES and len(lines) == 1:
        raise DataRejectedError(f"{label}: line 1 is longer than {_HEAD_BYTES} bytes; one point per line is expected.")
    return encoding, lines


def _delimiter(line: str) -> str:
    if ";" in line:
        return ";"
    if "\t" in line:
        return "\t"
    # "1,5 2,3 0,1": the comma is the decimal sign where spaces separate the columns.
    cells = line.split()
    if "," in line and not (len(cells) >= 3 and all(re.fullmatch(r"[^,]+(,[^,]+)?", cell) for cell in cells)):
        return ","
    return WHITE_SPACE


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip().strip("\"'") for cell in (line.split() if delimiter == WHITE_SPACE else line.split(delimiter))]
