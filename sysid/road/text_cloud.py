"""Point clouds in text files: delimiter, decimal sign and columns are found by looking at the first lines."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from sysid.errors import DataRejectedError

_MAX_COLUMNS = 200
_HEAD_BYTES = 65536
_AXIS = re.compile(r"^([xyz])[\s_\[(]*([a-zµ]*)[\])]*$")
_MISSING = {"", "nan", "-nan", "na", "n/a", "null", "none", "inf", "-inf", "+inf", "-", "--"}
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


def read_text_cloud(path: Path, unit: str, max_points: int) -> np.ndarray:
    """Read x, y, z of a text file as (n, 3) float64 in the unit of the file, NaN where a cell is missing.

    `unit` is only compared with units in the header (``x_mm``).  Raises DataRejectedError with file, row and remedy.
    """
    layout = _find_layout(path, unit)
    try:
        frame = _parse(path, layout, max_points, numeric=True)
    except DataRejectedError:
        raise
    except pd.errors.ParserError as error:
        raise _parser_sentence(path, layout, error) from error
    except (ValueError, OverflowError):
        # A cell is no number, or bytes are no text: read again as text, which is slower, to say which cell it is or to
        # accept a mark of absence.
        return _read_cell_by_cell(path, layout, max_points)
    return np.column_stack([frame[column].to_numpy(dtype=np.float64) for column in layout.columns])


def _parse(path: Path, layout: _Layout, max_points: int, *, numeric: bool) -> pd.DataFrame:
    # All columns are read though three are used: the parser then refuses rows with too many cells.
    frame = pd.read_csv(
        path,
        sep=layout.delimiter,
        decimal=layout.decimal,
        encoding=layout.encoding,
        header=None,
        names=list(range(layout.width)),
        skiprows=layout.skip_lines,
        nrows=max_points + 1,
        dtype=dict.fromkeys(layout.columns, np.float64 if numeric else str),
        low_memory=False,
        na_values=sorted(_MISSING - {""}) if numeric else None,
        keep_default_na=numeric,
        skipinitialspace=True,
        engine="c",
        comment="#",
    )
    if len(frame) > max_points:
        raise DataRejectedError(
            f"Scan {path.name} has more than {max_points} points; "
            "crop the cloud to a few metres around the bump or thin it."
        )
    return frame


def _read_cell_by_cell(path: Path, layout: _Layout, max_points: int) -> np.ndarray:
    try:
        frame = _parse(path, layout, max_points, numeric=False)
    except pd.errors.ParserError as error:
        raise _parser_sentence(path, layout, error) from error
    except UnicodeError as error:
        raise _encoding_sentence(path) from error
    values = []
    for column, name in zip(layout.columns, layout.names, strict=True):
        text = frame[column].fillna("").str.strip()
        if layout.decimal == ",":
            text = text.str.replace(",", ".", regex=False)
        number = pd.to_numeric(text, errors="coerce").to_numpy(dtype=np.float64)
        strange = np.flatnonzero(np.isnan(number) & ~text.str.lower().isin(_MISSING).to_numpy())
        if strange.size:
            row = int(strange[0])
            raise DataRejectedError(
                f"Scan {path.name}, column {name}, data row {row + 1}: {str(frame[column].iloc[row])[:40]!r} is not a "
                "number; correct that row or remove it."
            )
        values.append(number)
    return np.column_stack(values)


def _find_layout(path: Path, unit: str) -> _Layout:
    encoding, lines = _head_lines(path)
    header: str | None = None
    for index, line in enumerate(lines):
        stripped = line.strip().lstrip("\ufeff")
        if not stripped:
            continue
        # CloudCompare writes its header as a comment: "//X,Y,Z,Intensity".
        comment = stripped.startswith(("#", "//", ";", "%"))
        content = stripped.lstrip("#/;% ") if comment else stripped
        cells = [cell.strip().strip("\"'").lower() for cell in re.split(r"[,;\t]|\s+", content) if cell.strip()]
        if len(cells) > _MAX_COLUMNS:
            raise DataRejectedError(f"Scan {path.name} has more than {_MAX_COLUMNS} columns; export only x, y and z.")
        if any(_AXIS.match(cell) for cell in cells):
            if header is None:
                header = content
            continue
        if comment or (header is None and len(cells) == 1 and cells[0].isdigit()):
            # PTS files start with the number of points on a line of its own.
            continue
        if not re.match(r"^[+-]?[\d.,]", stripped) and header is None and cells[0] not in _MISSING:
            raise DataRejectedError(
                f"Scan {path.name}, line {index + 1}: '{stripped[:60]}' is neither numbers nor a header "
                "naming x, y and z; write a header x_m,y_m,z_m or plain columns x y z."
            )
        return _layout_of(path, unit, encoding, header, stripped, index)
    raise DataRejectedError(f"Scan {path.name} holds no rows of numbers; check the export of the scanner.")


def _layout_of(path: Path, unit: str, encoding: str, header_line: str | None, first: str, skip: int) -> _Layout:
    delimiter = _delimiter(first)
    cells = _split(first, delimiter)
    header = None
    if header_line is not None:
        # "X [m],Y [m]": the data tell better than the header what stands between its names.
        header = _split(header_line, delimiter if delimiter in header_line else _delimiter(header_line))
    width = len(cells)
    if header is not None and delimiter == "," and width == 2 * len(header):
        raise DataRejectedError(
            f"Scan {path.name}, line {skip + 1}: comma both between and inside the numbers; "
            "export with a decimal point or with semicolons between the columns."
        )
    if header is not None and len([cell for cell in cells if cell]) > len(header):
        raise DataRejectedError(
            f"Scan {path.name}, line {skip + 1}: {width} columns under a header of {len(header)}; name every column."
        )
    width = max(width, len(header or ()))
    if width < 3:
        raise DataRejectedError(
            f"Scan {path.name}, line {skip + 1}: '{first[:60]}' has {width} columns; x, y and z are expected."
        )
    decimal = "," if delimiter != "," and any("," in cell for cell in cells) else "."
    if header is None:
        columns, names = (0, 1, 2), ("x", "y", "z")
    else:
        columns, names = _columns_of(path, unit, header)
    return _Layout(encoding, delimiter, decimal, skip, columns, names, width)


def _columns_of(path: Path, unit: str, header: list[str]) -> tuple[tuple[int, int, int], tuple[str, str, str]]:
    found: dict[str, int] = {}
    for index, cell in enumerate(header):
        match = _AXIS.match(cell.strip().strip("\"'").lower())
        if match is None:
            continue
        axis, named_unit = match.group(1), _UNIT_ALIASES.get(match.group(2), match.group(2))
        if axis in found:
            raise DataRejectedError(
                f"Scan {path.name}: columns '{header[found[axis]]}' and '{cell}' both name {axis}; keep one of them."
            )
        if named_unit and named_unit != _UNIT_ALIASES.get(unit, unit):
            raise DataRejectedError(
                f"Scan {path.name}: column '{cell}' is in {named_unit} but the campaign file says unit = '{unit}'; "
                "make them agree."
            )
        found[axis] = index
    missing = [axis for axis in "xyz" if axis not in found]
    if missing:
        raise DataRejectedError(
            f"Scan {path.name}: no column {' and '.join(missing)} in the header ({', '.join(header)[:80]}); "
            "name the columns x_m, y_m and z_m."
        )
    x, y, z = (found[axis] for axis in "xyz")
    return (x, y, z), (header[x], header[y], header[z])


def _head_lines(path: Path) -> tuple[str, list[str]]:
    """Return the encoding and the first complete lines."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
        more = bool(stream.read(1))
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
        head = head[: len(head) // 2 * 2]
    elif b"\x00" in head:
        raise DataRejectedError(
            f"Scan {path.name} is neither text nor PLY nor LAS (it holds zero bytes); "
            "export the cloud as CSV, XYZ, PLY or LAS."
        )
    else:
        encoding = "utf-8-sig"
    try:
        text = head.decode(encoding)
    except UnicodeDecodeError:
        # Names of extra columns are often in the scanner's own code page; numbers are the same in all of them.
        encoding = "latin-1" if encoding == "utf-8-sig" else encoding
        text = head.decode(encoding, errors="replace")
    lines = re.split(r"\r\n|\n|\r", text)
    if more and len(lines) == 1:
        raise DataRejectedError(
            f"Scan {path.name}: line 1 is longer than {_HEAD_BYTES} bytes; one point per line is expected."
        )
    return encoding, lines[:-1] if more else lines


def _delimiter(line: str) -> str:
    if ";" in line:
        return ";"
    if "\t" in line:
        return "\t"
    # "1,5 2,3 0,1": the comma is the decimal sign where spaces separate the columns.
    cells = line.split()
    if "," in line and not (len(cells) >= 3 and all(re.fullmatch(r"[^,]+(,[^,]+)?", cell) for cell in cells)):
        return ","
    return r"\s+"


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip().strip("\"'") for cell in (line.split() if delimiter == r"\s+" else line.split(delimiter))]


def _parser_sentence(path: Path, layout: _Layout, error: Exception) -> DataRejectedError:
    match = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
    if match:
        return DataRejectedError(
            f"Scan {path.name}, line {int(match.group(2))}: {match.group(3)} columns where "
            f"{layout.width} are expected; correct that line."
        )
    return DataRejectedError(f"Scan {path.name} cannot be read as a table of numbers; export it again as CSV or XYZ.")


def _encoding_sentence(path: Path) -> DataRejectedError:
    return DataRejectedError(f"Scan {path.name} holds bytes that are not text; export it as UTF-8 text, PLY or LAS.")
