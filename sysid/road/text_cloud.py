"""Point clouds in text files: delimiter, decimal sign and columns are found by looking at the first lines."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.campaign.units import length_in_m
from sysid.errors import DataRejectedError
from sysid.logs.table_head import bare_unit, is_reading
from sysid.logs.text_numbers import (
    MISSING,
    SIGNS,
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


@dataclass(frozen=True)
class _Layout:
    """How the file is written: encoding, delimiter (a pattern), decimal sign, lines before the data, columns of xyz,
    and counts of the campaign's unit in a count of each."""

    encoding: str
    delimiter: str
    decimal: str
    skip_lines: int
    columns: tuple[int, int, int]
    names: tuple[str, str, str]
    width: int
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)


def read_text_cloud(data: bytes, label: str, unit: str, max_points: int) -> np.ndarray:
    """Read x, y, z of a text file as (n, 3) float64 in the unit of the file, NaN where a cell is missing.

    `data` is its content, `label` begins every sentence about it; columns whose unit the file says (``x_mm``, or a row
    of units) are converted to `unit`.  Raises DataRejectedError with file, row and remedy.
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
            points[:, axis] = values * layout.factors[axis]
    return points


def _find_layout(data: bytes, label: str, unit: str) -> _Layout:
    encoding, lines = _head_lines(data, label)
    header: str | None = None
    between: list[str] = []
    names_at = _line_of_names(lines)
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
        if header is None and index >= names_at and any(_AXIS.match(cell) for cell in cells):
            header = content
            continue
        if comment or (header is None and len(cells) == 1 and cells[0].isdigit()):
            # PTS files start with the number of points on a line of its own.
            continue
        if not re.match(r"^[\"']?[+-]?[\d.,]", stripped.translate(SIGNS)) and cells[0] not in MISSING:
            if header is not None and not any(is_reading(cell) for cell in cells):
                between.append(stripped)
                continue
            # Whatever is above the names of the columns is no table yet.
            if index < names_at:
                continue
            if header is None:
                raise DataRejectedError(
                    f"{label}, line {index + 1}: '{stripped[:60]}' is neither numbers nor a header "
                    "naming x, y and z; write a header x_m,y_m,z_m or plain columns x y z."
                )
        return _layout_of(label, unit, encoding, header, between, stripped, index)
    raise DataRejectedError(f"{label} holds no rows of numbers; check the export of the scanner.")


def _line_of_names(lines: list[str]) -> int:
    """The line that names x, y and z, among the first ones; -1 where none does."""
    for index, line in enumerate(lines[: limits.HEADER_LINES]):
        if len(line) < limits.NAME_BYTES * limits.CLOUD_COLUMNS:
            cells = [cell.strip("\"'").lower() for cell in re.split(r"[,;\t]|\s+", line.strip())]
            if {match[1] for match in map(_AXIS.match, cells) if match is not None} == set("xyz"):
                return index
    return -1


def _layout_of(
    label: str, unit: str, encoding: str, header_line: str | None, between: list[str], first: str, skip: int
) -> _Layout:
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
        return _Layout(encoding, delimiter, decimal, skip, (0, 1, 2), ("x", "y", "z"), width)
    x, y, z = _columns_of(label, header)
    units = next((row for row in (_split(line, delimiter) for line in between) if len(row) == len(header)), [])
    names = header[x], header[y], header[z]
    written = [_unit_of(label, header[i], units[i] if i < len(units) else "") for i in (x, y, z)]
    return _Layout(encoding, delimiter, decimal, skip, (x, y, z), names, width, _factors(label, unit, names, written))


def _columns_of(label: str, header: list[str]) -> tuple[int, int, int]:
    columns: dict[str, int] = {}
    for index, cell in enumerate(header):
        match = _AXIS.match(cell.strip().strip("\"'").lower())
        if match is None:
            continue
        axis = match.group(1)
        if axis in columns:
            raise DataRejectedError(
                f"{label}: columns '{header[columns[axis]]}' and '{cell}' both name {axis}; keep one of them."
            )
        columns[axis] = index
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise DataRejectedError(
            f"{label}: no column {' and '.join(missing)} in the header ({', '.join(header)[:80]}); "
            "name the columns x_m, y_m and z_m."
        )
    return columns["x"], columns["y"], columns["z"]


def _unit_of(label: str, name: str, below: str) -> tuple[str, float] | None:
    """The unit of a column by its name, or by the row of units below it, and metres in it; None where none is said."""
    match = _AXIS.match(name.strip().strip("\"'").lower())
    said = [unit for unit in ((match[2] if match is not None else ""), bare_unit(below)) if unit]
    sizes = [length_in_m(unit) for unit in said]
    if not said:
        return None
    size = sizes[0]
    if size is None or sizes[-1] != size:
        raise DataRejectedError(f"{label}: column '{name}' is in {' and '.join(said)}; write x, y and z in m.")
    return said[0], size


def _factors(
    label: str, unit: str, names: tuple[str, ...], written: list[tuple[str, float] | None]
) -> tuple[float, float, float]:
    """Counts of `unit` in a count of every column, by the units that the file says.

    Raises
    ------
    DataRejectedError
        If the file says units of x or y and none is `unit`: one of both is wrong.
    """
    own = length_in_m(unit) or 1.0
    said = [(name, *found) for name, found in zip(names, written, strict=True) if found is not None]
    # Heights alone may have a unit of their own.
    if said and written[:2] != [None, None] and all(size != own for _, _, size in said):
        name, other, _ = said[0]
        raise DataRejectedError(
            f"{label}: column '{name}' is in {other} but the campaign file says unit = '{unit}'; make them agree."
        )
    x, y, z = (1.0 if found is None else found[1] / own for found in written)
    return x, y, z


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
