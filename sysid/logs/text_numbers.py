"""Numbers in text files, the same for logs, profiles and point clouds: encoding, lines, cells, decimal mark."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TextIO

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError
from sysid.logs.names import normal_name

#: Delimiter of columns that white space separates.
WHITE_SPACE = r"\s+"
DECIMAL_COMMA = re.compile(r'^\s*"?[-+]?[\d.]*,\d+([eE][-+]?\d+)?"?\s*$')
#: First characters of lines of comment.
COMMENT = ("#", "%")
#: What C libraries of Windows write for numbers that are none; rounded to few digits, ``1.#QNAN`` becomes ``1.#QO``.
_WINDOWS_NAN = [
    f"{sign}1{mark}#{word}{zeros * '0'}"
    for sign in ("", "-")
    for mark in ".,"
    for word in ("INF", "IND", "QNAN", "SNAN", "J", "IO", "R", "QO", "QNB", "T", "SO", "SNB")
    for zeros in range(16)
]
#: What stands in a cell without a reading, in small letters.
MISSING = frozenset(
    ["", "nan", "+nan", "-nan", "na", "n/a", "#n/a", "<na>", "null", "none", "-", "--", "over"]
    + [sign + word for sign in ("", "+", "-") for word in ("inf", "infinity")]
    + [sign + word for sign in ("", "-") for word in ("nan(ind)", "nan(snan)")]
    + [word.lower() for word in _WINDOWS_NAN]
    + ["∞", "-∞", "+∞"]
)
#: Signs of typesetting for those of a keyboard: minus, and spaces that do not break a line.
SIGNS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u00a0": " ", "\u2007": " ", "\u2009": " ", "\u202f": " "})
#: A number with spaces or apostrophes between its thousands.
_GROUPED = "[-+]?\\d{1,3}(?:[ '\u2019]\\d{3})+(?:[.,]\\d*)?"
#: Texts up to this size [bytes] that hold numbers alone are read by NumPy: for these, loading pandas takes longer.
_SMALL = 4 << 20
_PLAIN = re.compile(r"(?:[-+0-9.eE,;|\s]++|NaN)*+")
#: Rows that the parser holds at a time.
_PIECE_ROWS = 100_000
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_COMMENT_LINE = re.compile(r"\n[^\S\n]*[#%][^\n]*")


class LongRowError(ValueError):
    """A row (line `number` of the file, from 1) with more cells than there are columns."""

    def __init__(self, number: int, cells: int):
        super().__init__(f"line {number} has {cells} cells")
        self.number = number
        self.cells = cells


class CellError(ValueError):
    """A cell that is no number: index of its row among those read (from 0), place of its column (from 0), its text."""

    def __init__(self, row: int, place: int, text: str):
        super().__init__(f"row {row}, column {place}: {text}")
        self.row = row
        self.place = place
        self.text = text


@dataclass(frozen=True)
class NumberTable:
    """How the numbers of a text file are written.

    - `label` begins every message about the file;
    - `skip_lines` stand before the first row, whose cells belong to `names`; with `blank_rows` a blank line is a row
      without readings, else it is skipped; lines that begin with ``#`` or ``%`` are no rows;
    - `strict` refuses bytes that are no text.
    """

    data: bytes
    label: str
    encoding: str
    delimiter: str
    decimal: str
    skip_lines: int
    names: tuple[str, ...]
    blank_rows: bool = True
    strict: bool = False
    line_length: int = limits.LINE_LENGTH
    most_rows: int = limits.LOG_ROWS

    def rows_of_text(self) -> _Rows:
        """The text behind the lines to skip, without lines of comment."""
        stream = self._stream()
        for _ in range(self.skip_lines):
            stream.readline()
        return _Rows(stream)

    def lines(self) -> Iterator[str]:
        """All lines, cut at one more character than a line may have."""
        stream = self._stream()
        return iter(partial(stream.readline, self.line_length + 1), "")

    def _stream(self) -> TextIO:
        errors = "strict" if self.strict else "replace"
        return io.TextIOWrapper(io.BytesIO(self.data), encoding=self.encoding, errors=errors)


class _Rows(io.TextIOBase):
    """Rows of a text; the parser's own comments would also cut a row at a ``#`` in one of its cells."""

    def __init__(self, stream: TextIO):
        self._stream = stream

    def read(self, size: int = -1) -> str:  # type: ignore[override]
        """At least `size` characters, to the end of a line; nothing at the end of the text."""
        while lines := self._stream.read(size) + self._stream.readline():
            if rows := _without_comments(lines):
                return rows
        return ""

    def readline(self, size: int = -1) -> str:  # type: ignore[override]
        """The next row, cut at `size` characters."""
        while (line := self._stream.readline(size)).lstrip().startswith(COMMENT):
            pass
        return line


def _without_comments(lines: str) -> str:
    if not any(mark in lines for mark in COMMENT):
        return lines
    return _COMMENT_LINE.sub("", "\n" + lines)[1:]


def encoding_of(data: bytes) -> str:
    """Encoding of a text by its first megabyte: UTF-8, UTF-16 with or without its mark, else that of Windows."""
    head = data[: limits.LINE_LENGTH]
    if head[:2] in _UTF16:
        return "utf-16"
    even, odd = head[0:4096:2].count(0), head[1:4096:2].count(0)
    if max(even, odd) > 0.4 * min(len(head), 4096) / 2 and min(even, odd) == 0:
        return "utf-16-be" if even > odd else "utf-16-le"
    try:
        # A character of several bytes cut by the end of the head is no fault.
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def head_lines(data: bytes, encoding: str, size: int) -> list[str]:
    """Complete lines of the first `size` bytes with names as they are compared; one that is cut, where it is alone."""
    text = normal_name(codecs.decode(data[: size // 2 * 2], encoding, "replace").lstrip("\ufeff"))
    lines = re.split(r"\r\n|\r|\n", text)
    return lines[:-1] if len(data) > size and len(lines) > 1 else lines


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line without quotation marks and space around them."""
    if delimiter == WHITE_SPACE:
        return [c.strip("\"'") for c in line.split()]
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return [c.strip().strip('"') for c in line.split(delimiter)]


def count_rows(table: NumberTable) -> tuple[int, int]:
    """Number of rows and the largest number of cells in one, at most as many as there are names.

    Raises
    ------
    DataRejectedError
        If there are NUL bytes, lines without end, more rows than are read, or a row between white space with fewer
        cells than there are names: an empty cell leaves no mark there, and those behind it would move up.
    LongRowError
        If a row has more cells than there are names: the parser would shift its numbers into other columns.
    UnicodeDecodeError
        If the table is strict and holds bytes that are no text.
    """
    label, names = table.label, len(table.names)
    lines = max(table.data.count(b"\n"), table.data.count(b"\r"))
    # Blank lines are allowed for, but not without end.
    if lines > table.skip_lines + (1 if table.blank_rows else 3) * table.most_rows:
        raise DataRejectedError(
            f"{label} has {lines} lines, at most {table.most_rows} rows are read; cut or thin it, and remove blank "
            "lines."
        )
    width = rows = short = cells = 0
    spaced = table.delimiter == WHITE_SPACE
    for number, line in enumerate(table.lines(), start=1):
        if "\0" in line:
            raise DataRejectedError(
                f"{label}: line {number} contains NUL bytes (zero bytes), as a file cut off while it was written does; "
                "export it again or delete what follows."
            )
        if len(line) > table.line_length:
            raise DataRejectedError(
                f"{label}: line {number} is longer than {table.line_length} characters; export the file as a table."
            )
        if number <= table.skip_lines:
            continue
        count = len(line.split()) if spaced else line.count(table.delimiter) + 1
        if count != names and (count > names or spaced):
            if line.lstrip().startswith(COMMENT):
                continue
            if count > names:
                count = _exact_count(line, number, table)
            elif count and not short:
                short, cells = number, count
        # The last row may have been cut while it was written.
        if short and count and number > short:
            raise DataRejectedError(
                f"{label}: row {short} has {cells} cells between white space under {names} names, and which of them "
                "is empty cannot be told; export the file with commas, semicolons or tabs between its columns."
            )
        if count > width:
            width = count
        rows += table.blank_rows or not line.isspace()
        if rows > table.most_rows:
            raise DataRejectedError(f"{label} has more rows than the {table.most_rows} that are read; cut or thin it.")
    return rows, width


def _exact_count(line: str, number: int, table: NumberTable) -> int:
    names = len(table.names)
    cells = cells_of(line.rstrip("\n"), table.delimiter)
    count = len(cells)
    while len(cells) > names and not cells[-1]:
        cells.pop()
    if len(cells) > names:
        raise LongRowError(number, len(cells))
    return count


def read_numbers(table: NumberTable, places: Mapping[int, str], rows: int, width: int) -> dict[str, np.ndarray]:
    """Read columns of a table as float64, NaN where a cell is empty or says so.

    Parameters
    ----------
    places : place of every wanted column (from 0, below `width`) with its name.
    rows, width : from :func:`count_rows`.

    Raises
    ------
    CellError
        If a cell is no number and no mark of absence.
    DataRejectedError
        If the text is no regular table or does not fit into memory.
    UnicodeDecodeError
        If the table is strict and holds bytes that are no text.
    """
    if rows * len(places) > limits.LOG_NUMBERS + limits.CLOUD_POINTS:
        raise DataRejectedError(
            f"{table.label} holds {rows * len(places)} numbers, at most {limits.LOG_NUMBERS} are read; cut it to the "
            "time of the test."
        )
    plain = _plain(table, places, rows)
    if plain is not None:
        return plain
    import pandas as pd

    try:
        return _filled(table, places, rows, width, as_text=False)
    except pd.errors.EmptyDataError:
        return {name: np.empty(0) for name in places.values()}
    except pd.errors.ParserError as error:
        raise DataRejectedError(f"{table.label} is not a regular table of numbers: {_reason(error)}.") from None
    except MemoryError:
        raise DataRejectedError(f"{table.label} does not fit into memory; cut or thin it.") from None
    except UnicodeDecodeError:
        raise
    except (ValueError, OverflowError):
        # A cell is no number: read again as text, which is slower, to accept a mark of absence or to name the cell.
        return _as_text(table, places, rows, width)


def _plain(table: NumberTable, places: Mapping[int, str], rows: int) -> dict[str, np.ndarray] | None:
    """Columns of a small text whose cells are empty, or numbers as all programs write them; None for others."""
    if len(table.data) > _SMALL or table.decimal != "." or not rows:
        return None
    with table.rows_of_text() as stream:
        text = stream.read()
    if text.isspace() or not text or not _PLAIN.fullmatch(text):
        return None
    delimiter = None if table.delimiter == WHITE_SPACE else table.delimiter
    if delimiter is not None:
        mark = re.escape(delimiter)
        text = re.sub(f"(?m)(?<={mark}) *(?={mark}|$)|^ *(?={mark})", "nan", text)
    try:
        numbers = np.loadtxt(io.StringIO(text), delimiter=delimiter, comments=None, usecols=list(places), ndmin=2)
    except ValueError:
        return None
    # Blank lines may be rows without readings.
    if len(numbers) != rows or np.isinf(numbers).any():
        return None
    return {name: numbers[:, i].copy() for i, name in enumerate(places.values())}


def read_text(table: NumberTable, place: int, width: int) -> Any:
    """Cells of the column at `place` as a pandas series of text, empty where there is none.

    `width` is that of :func:`count_rows`.

    Raises
    ------
    DataRejectedError
        If the text is no regular table.
    """
    import pandas as pd

    try:
        with table.rows_of_text() as stream, _pieces(table, stream, {place: ""}, width, True) as pieces:
            columns = [piece[place].fillna("") for piece in pieces]
    except pd.errors.EmptyDataError:
        columns = []
    except pd.errors.ParserError as error:
        raise DataRejectedError(f"{table.label} is not a regular table of numbers: {_reason(error)}.") from None
    return pd.concat(columns, ignore_index=True) if columns else pd.Series([], dtype=str)


def _as_text(table: NumberTable, places: Mapping[int, str], rows: int, width: int) -> dict[str, np.ndarray]:
    import pandas as pd

    try:
        return _filled(table, places, rows, width, as_text=True)
    except (CellError, UnicodeDecodeError):
        raise
    except pd.errors.ParserError as error:
        raise DataRejectedError(f"{table.label} is not a regular table of numbers: {_reason(error)}.") from None
    except (ValueError, OverflowError, MemoryError):
        raise DataRejectedError(
            f"{table.label} has text among its numbers; remove it and begin lines of text with '#'."
        ) from None


def _filled(
    table: NumberTable, places: Mapping[int, str], rows: int, width: int, *, as_text: bool
) -> dict[str, np.ndarray]:
    # Filled piece by piece: a large file then needs the memory of its numbers only.
    result = {name: np.full(rows, np.nan) for name in places.values()}
    filled = 0
    with table.rows_of_text() as stream, _pieces(table, stream, places, width, as_text) as pieces:
        for piece in pieces:
            for place, name in places.items():
                column = piece[place]
                numbers = _from_text(table, column, filled, place) if as_text else column.to_numpy()
                result[name][filled : filled + len(piece)] = numbers
            filled += len(piece)
    return {name: values[:filled] for name, values in result.items()}


def _pieces(table: NumberTable, stream: _Rows, places: Mapping[int, str], width: int, text: bool) -> Any:
    import pandas as pd

    return pd.read_csv(
        stream,
        sep=table.delimiter,
        decimal=table.decimal,
        header=None,
        names=list(range(width)),
        usecols=list(places),
        index_col=False,
        skipinitialspace=True,
        skip_blank_lines=not table.blank_rows,
        engine="c",
        low_memory=False,
        chunksize=_PIECE_ROWS,
        dtype=str if text else np.float64,
        na_values=None if text else ["-", "--", "NAN", "Inf", "none", "OVER", "over", *_WINDOWS_NAN],
        keep_default_na=not text,
    )


def _from_text(table: NumberTable, column: Any, start: int, place: int) -> np.ndarray:
    import pandas as pd

    text = column.fillna("").str.translate(SIGNS).str.strip()
    grouped = text.str.fullmatch(_GROUPED).to_numpy(dtype=bool)
    if grouped.any():
        text = text.where(~grouped, text.str.replace("[ '\u2019]", "", regex=True))
    if table.decimal == ",":
        # Exchanged, so that a point, which may stand between thousands, makes a cell no number.
        text = text.str.translate(str.maketrans(",.", ".,"))
    number = pd.to_numeric(text, errors="coerce").to_numpy(dtype=np.float64)
    strange = np.flatnonzero(np.isnan(number) & ~text.str.lower().isin(MISSING).to_numpy())
    if strange.size:
        row = int(strange[0])
        raise CellError(start + row, place, str(column.iloc[row]))
    return np.asarray(number)


def _reason(error: Exception) -> str:
    if "EOF inside string" in str(error):
        return "a quotation mark is never closed; remove it"
    if "out of memory" in str(error).lower():
        return "it does not fit into memory; cut or thin it"
    return "its rows and cells cannot be told apart; export it again"
