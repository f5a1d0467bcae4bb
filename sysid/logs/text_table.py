"""A table in a text: encoding, delimiter, decimal mark, header and units are found from the text itself."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError
from sysid.logs.channels import within_range
from sysid.logs.input_file import FileRefusedError, InputFile, read_file
from sysid.logs.table_head import MOST_ROWS, head_below, rows_above_numbers
from sysid.logs.text_instants import has_instants, is_coarse_instant, is_instant, read_instants
from sysid.logs.text_numbers import (
    COMMENT,
    DECIMAL_COMMA,
    WHITE_SPACE,
    CellError,
    LongRowError,
    NumberTable,
    cells_of,
    count_rows,
    encoding_of,
    head_lines,
    read_numbers,
)
from sysid.wording import shorten

#: Bytes in which delimiter and header are looked for.
_HEAD_BYTES = 1 << 20
_COMPARED = 60  # characters of a name that are compared with a misspelt one
_COMMENT = (*COMMENT, '"#')
#: Columns of names of several words that stand under each other are divided by two spaces.
_WIDE = "  "
_DELIMITERS = (",", ";", "\t", "|", WHITE_SPACE, _WIDE)
#: One of several columns of a name.
_NUMBERED = re.compile(r"(.*) #([1-9]\d{0,3})")
#: Longest line whose cells may be divided by spaces [characters].
_SPACED_LINE = 20_000
#: A number with a decimal mark, one that may as well be a thousand, and how many of the former are looked at.
_MARKED = re.compile(r"[-+]?[\d.]*[.,]\d+(?:[eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+")
_COMMAS = re.compile(r"[-+]?\d{1,3}(?:,\d{3})+\.\d*")
_MARKED_CELLS = 100
#: Characters that no text holds; NUL bytes are counted elsewhere.
_CONTROL = re.compile(r"[\x01-\x08\x0e-\x1f]")
_BINARY = {b"\x1f\x8b": "a gzip file", b"%PDF": "a PDF"}
#: What spreadsheets write where they have no number, in English and German.
_ERROR_MARKS = (
    "#N/A",
    "#NV",
    "#VALUE!",
    "#WERT!",
    "#DIV/0!",
    "#REF!",
    "#BEZUG!",
    "#NAME?",
    "#NUM!",
    "#ZAHL!",
    "#NULL!",
)


@dataclass(frozen=True)
class Layout:
    """How a table is written: text encoding, delimiter, decimal mark, line of the header (from 0) and its names.

    `skipped` lines stand between the names and the first row of numbers; `units` are the cells of the one of them that
    holds units, empty without one.
    """

    encoding: str
    delimiter: str
    decimal: str
    header_line: int
    names: tuple[str, ...]
    skipped: int = 0
    units: tuple[str, ...] = ()

    @property
    def first_row(self) -> int:
        """Line of the first row of numbers, from 1."""
        return self.header_line + 2 + self.skipped


@dataclass(frozen=True)
class TextTable:
    """A table in a text whose layout is known; `label` begins every sentence about it."""

    data: bytes = field(repr=False)
    label: str
    layout: Layout

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.layout.names

    def unit(self, place: int) -> str | None:
        """The unit of a column by the row of units, None where it is not said."""
        return (self.layout.units[place] if place < len(self.layout.units) else "") or None

    def place(self, name: str) -> int | None:
        """Place of the column with a name, or of the second of several by ``NAME #2``; None where there is none.

        Raises
        ------
        DataRejectedError
            If it stands twice in the header.
        """
        at = [i for i, n in enumerate(self.names) if n == name]
        if len(at) > 1:
            raise DataRejectedError(
                f"{self.label}: the column '{shorten(name)}' stands twice in the header (columns {at[0] + 1} and "
                f"{at[1] + 1}); name the column '{shorten(name)} #1' or '{shorten(name)} #2'."
            )
        numbered = _NUMBERED.fullmatch(name)
        if not at and numbered is not None:
            at = [i for i, n in enumerate(self.names) if n == numbered[1]][int(numbered[2]) - 1 :]
        return at[0] if at else None

    def first_cell(self, place: int) -> str:
        """The first filled cell of a column, within the first rows; empty where there is none."""
        rows = islice(_body(self._numbers()), 200)
        cells = (row[place] for row in rows if place < len(row))
        return next((cell for cell in cells if cell.strip()), "")

    def has_instants(self, place: int) -> bool:
        """Whether a column holds dates or times of day."""
        return has_instants(self._numbers(), place)

    def read(self, places: Sequence[int], instants: Sequence[int] = ()) -> dict[int, np.ndarray]:
        """Columns (rows,) as float64, NaN where a cell is empty or beyond what is measured; `instants` in seconds.

        Raises
        ------
        DataRejectedError
            If a cell is no number, a row too long, or there is none; the sentence names column and row.
        """
        table, names = self._numbers(), self.names
        try:
            rows, width = count_rows(table)
        except LongRowError as error:
            raise DataRejectedError(
                f"{self.label}: row {error.number} has {error.cells} cells, the header has {len(names)} names; correct "
                "that row."
            ) from None
        there = [place for place in places if place < width]
        if not there:
            raise DataRejectedError(f"{self.label} has a header but no rows; export the log again.")
        try:
            numbers = read_numbers(table, {p: str(p) for p in there if p not in instants}, rows, width)
            columns = {int(place): values for place, values in numbers.items()}
            columns |= {place: read_instants(table, place, width) for place in there if place in instants}
        except CellError as error:
            raise DataRejectedError(self._cell_sentence(error)) from None
        count = len(next(iter(columns.values())))
        if count == 0:
            raise DataRejectedError(f"{self.label} has a header but no rows; export the log again.")
        columns = {place: within_range(values) for place, values in columns.items()}
        return columns | {place: np.full(count, np.nan) for place in places if place not in columns}

    def _numbers(self) -> NumberTable:
        at = self.layout
        return NumberTable(self.data, self.label, at.encoding, at.delimiter, at.decimal, at.first_row - 1, at.names)

    def _cell_sentence(self, error: CellError) -> str:
        cell, decimal = error.text.strip(), self.layout.decimal
        hint = "correct or empty the cell"
        if decimal == "." and DECIMAL_COMMA.match(cell):
            hint = "use the decimal point in every cell"
        elif decimal == "," and _MARKED.fullmatch(cell):
            hint = "use the decimal comma in every cell, and no points between thousands"
        elif _COMMAS.fullmatch(cell):
            hint = "export the log without commas between thousands"
        elif is_coarse_instant(cell):
            hint = "it is a date or a time without seconds: export the time with fractions of a second"
        elif is_instant(cell):
            hint = "it is a time that is none, or is written differently in other rows: export the time in seconds"
        return (
            f"{self.label}: row {error.row + self.layout.first_row}, column '{shorten(self.names[error.place])}' has "
            f"'{shorten(error.text, 40)}', expected a number; {hint}."
        )


def open_table(
    source: Path | InputFile, label: str, wanted: Sequence[str], is_key: Callable[[str], bool], units_row: bool = False
) -> TextTable:
    """Find the table in a text from its first megabyte.

    Parameters
    ----------
    source : the file, or its path.
    label : its name for messages.
    wanted : names of columns, of which the header has at least one, or a key.
    is_key : whether a name is that of the column over which the others are given, such as time.
    units_row : whether the row below the names holds units, whatever stands there.

    Raises
    ------
    DataRejectedError
        If the file is empty or binary, has no such header, or has too many columns.
    """
    data = without_error_marks(file_content(source, label).data)
    head = data[:_HEAD_BYTES]
    if not head.strip(b"\0 \t\r\n\xef\xbb\xbf\xff\xfe"):
        raise DataRejectedError(f"{label} is empty; export the log again.")
    for magic, what in _BINARY.items():
        if head.startswith(magic):
            raise DataRejectedError(f"{label} is {what}, not text; export the log as CSV.")
    encoding = encoding_of(data)
    lines = head_lines(data, encoding, _HEAD_BYTES)
    text = "\n".join(lines)[:65536]
    if len(_CONTROL.findall(text)) > 0.01 * len(text):
        raise DataRejectedError(f"{label} is binary, not text; export the log as CSV.")
    layout = _header(lines, label, encoding, wanted, is_key)
    known = set(wanted)
    keys = [is_key(name) for name in layout.names]
    used = [name in known or key for name, key in zip(layout.names, keys, strict=True)]
    below = lines[layout.header_line + 1 :][: MOST_ROWS + 1]
    rows = [[] if ln.lstrip().startswith(_COMMENT) else cells_of(ln, layout.delimiter) for ln in below]
    between, units = head_below(rows, used, keys, units_row)
    layout = replace(layout, skipped=between, units=units)
    table = TextTable(data, label, layout)
    return replace(table, layout=replace(layout, decimal=_decimal_mark(table, np.flatnonzero(used).tolist())))


def file_content(source: Path | InputFile, label: str) -> InputFile:
    """The file, read now where only its path is given.

    Raises
    ------
    DataRejectedError
        If it is no regular file, too large, or cannot be read.
    """
    try:
        return source if isinstance(source, InputFile) else read_file(source, limits.LOG_BYTES)
    except FileRefusedError as error:
        most = f"; at most {limits.LOG_BYTES / 1e6:.0f} MB are read" if error.kind == "size" else ""
        raise DataRejectedError(f"{label} is no regular file that can be read{most}; name a file.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no valid path"
        raise DataRejectedError(f"{label} cannot be read ({reason}).") from None


def without_error_marks(data: bytes) -> bytes:
    """The text with `n/a` for the error marks of spreadsheets, whose first character would begin a comment."""
    if b"#" not in data:
        return data
    for mark in _ERROR_MARKS:
        for encoding in ("latin-1", "utf-16-le", "utf-16-be"):
            written = mark.encode(encoding)
            if written in data:
                data = data.replace(written, "n/a".encode(encoding))
    return data


def _body(table: NumberTable) -> Iterator[list[str]]:
    """Cells of the rows of numbers."""
    with table.rows_of_text() as stream:
        for line in iter(lambda: stream.readline(table.line_length), ""):
            yield cells_of(line.rstrip("\r\n"), table.delimiter)


def _decimal_mark(table: TextTable, places: Sequence[int]) -> str:
    """Decimal mark of most of the first numbers with one in the columns at `places`."""
    numbers, delimiter = table._numbers(), table.layout.delimiter
    if delimiter == "," and b'"' not in table.data[:_HEAD_BYTES]:
        return "."

    def cells_with_mark() -> Iterator[str]:
        with numbers.rows_of_text() as stream:
            for row in iter(lambda: stream.readline(numbers.line_length), ""):
                if (delimiter != "," and "," in row) or "." in row or '"' in row:
                    quick = delimiter not in (",", WHITE_SPACE)
                    cells = row.split(delimiter) if quick else cells_of(row.rstrip("\r\n"), delimiter)
                    yield from (cells[p].strip().strip('"') for p in places if p < len(cells))

    marked = list(islice((cell for cell in cells_with_mark() if _MARKED.fullmatch(cell)), _MARKED_CELLS))
    commas = sum("," in cell for cell in marked)
    # A point may stand between thousands, as in 1.234.
    points = sum("," not in cell and not _THOUSANDS.fullmatch(cell) for cell in marked)
    return "," if commas > points else "."


def _header(
    lines: list[str], label: str, encoding: str, wanted: Sequence[str], is_key: Callable[[str], bool]
) -> Layout:
    known = {*wanted, *(match[1] for name in wanted if (match := _NUMBERED.fullmatch(name)) is not None)}
    best: tuple[tuple[int, bool], int, str, list[str]] = ((0, False), 0, ",", [])
    for number, line in enumerate(lines[: limits.HEADER_LINES]):
        comment = line.lstrip().startswith(_COMMENT)
        for delimiter in _DELIMITERS:
            spaced = delimiter in (WHITE_SPACE, _WIDE)
            if line.count(delimiter) >= 20 * limits.LOG_COLUMNS or (spaced and len(line) > _SPACED_LINE):
                continue
            names = _names(line.lstrip(' "#%') if comment else line, delimiter)
            hits = 2 * len(known.intersection(names)) + any(is_key(n) for n in names)
            # Names behind a mark of comment count where no others are; words of a sentence are no names.
            better = hits and (hits, not comment) > best[0]
            if better and (not spaced or _fits(lines[number + 1 :], names)):
                best = ((hits, not comment), number, delimiter, names)
        # No line has more names than those known, and a key.
        if best[0] == (2 * len(known) + 1, True):
            break
    _, number, delimiter, names = best
    first = next((ln for ln in lines if ln.strip() and not ln.lstrip().startswith(_COMMENT)), "")
    if not names:
        raise DataRejectedError(_no_header(first, label, wanted))
    width = max(len(names), first.count(delimiter) + 1 if delimiter not in (WHITE_SPACE, _WIDE) else 0)
    if width > limits.LOG_COLUMNS:
        raise DataRejectedError(
            f"{label} has {width} columns, at most {limits.LOG_COLUMNS} are read; export the sensor columns only."
        )
    # A trailing delimiter makes an empty last name; other empty names get one of their own.
    names = [n or f"(column {i + 1})" for i, n in enumerate(names)]
    sample = [ln for ln in lines[number + 1 : number + 101] if ln.strip() and not ln.lstrip().startswith(_COMMENT)]
    pairs = all(ln.count(",") + 1 >= 2 * len(names) - 1 and '"' not in ln for ln in sample)
    if delimiter == "," and sample and pairs and len(names) > 1:
        raise DataRejectedError(
            f"{label}: row {number + 2} has {sample[0].count(',') + 1} cells under {len(names)} column names, as when "
            "the comma separates columns and marks decimals; export with semicolons between columns."
        )
    return Layout(encoding, WHITE_SPACE if delimiter == _WIDE else delimiter, ".", number, tuple(names))


def _names(line: str, delimiter: str) -> list[str]:
    if delimiter == _WIDE:
        return re.split(r"\s{2,}|\t", line.strip())
    return cells_of(line, delimiter)


def _fits(lines: Sequence[str], names: list[str]) -> bool:
    """Whether rows of numbers between white space follow, one number per name."""
    rows = [ln.split() for ln in lines[:MOST_ROWS] if ln.strip() and not ln.lstrip().startswith(_COMMENT)]
    first = rows_above_numbers(rows, range(len(names)), None)
    return len(names) > 1 and len(rows) > first and len(rows[first]) == len(names)


def _no_header(first: str, label: str, wanted: Sequence[str]) -> str:
    names = max((cells_of(first, d) for d in (",", ";", "\t", "|")), key=len) if len(first) < 1_000_000 else []
    if len(names) > limits.LOG_COLUMNS:
        return (
            f"{label} has {len(names)} columns, at most {limits.LOG_COLUMNS} are read; export the sensor columns only."
        )
    numeric = [n for n in names if re.fullmatch(r"[-+\d.,eE]+", n)]
    columns = ", ".join(shorten(w) for w in wanted[:3]) or "columns of sensors"
    expected = f"expected time_s and {columns}{', ...' if len(wanted) > 3 else ''}"
    if names and len(numeric) == len(names):
        return f"{label} has no header line with column names; {expected}."
    none = "none of the columns of campaign.toml" if wanted else "no column of time"
    shown = ", ".join(f"'{shorten(n, 30)}'" for n in names[:6]) + (", ..." if len(names) > 6 else "")
    return f"{label} has {none} in its first {limits.HEADER_LINES} lines (found {shown}); {expected}."


def near_names(name: str, names: Iterable[str]) -> str:
    """Half a sentence with the nearest of the names in the file, or nothing."""
    # Long names are compared by their beginning: comparing takes the product of their lengths.
    beginnings = {n[:_COMPARED]: n for n in list(names)[: limits.LOG_COLUMNS]}
    near = difflib.get_close_matches(name[:_COMPARED], beginnings, n=1, cutoff=0.6)
    return f" (the file has '{shorten(beginnings[near[0]])}')" if near else ""
