"""OpenCRG files written from the text of ASAM OpenCRG 1.2, chapter 6, without any library for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Payload formats: characters or bytes per number, numbers per record of 80.
WIDTH = {"LRFI": (10, 8), "LDFI": (20, 4), "KRBI": (4, 20), "KDBI": (8, 10)}


def crg_file(
    columns: np.ndarray,
    channels: Sequence[str],
    *,
    increment: float,
    kind: str = "LRFI",
    road: Sequence[str] = (),
    sections: Sequence[str] = (),
) -> bytes:
    """A whole file with `columns` (rows, channels) under `channels` definitions, one lateral cut every `increment` [m].

    `road` further lines of $ROAD_CRG, `sections` whole sections that stand before the data.  The end of the reference
    line is named: ASAM's library wants it for binary data, where padding could be mistaken for a row.
    """
    if kind[0] == "K" and not any("END_U" in line for line in road):
        road = ["REFERENCE_LINE_START_U = 0.0", f"REFERENCE_LINE_END_U = {increment * (len(columns) - 1)}", *road]
    header = [
        "$CT ! written by a test",
        "a bump",
        "$",
        "$ROAD_CRG ! reference line",
        f"REFERENCE_LINE_INCREMENT = {increment}",
        *road,
        "$",
        *sections,
        "$KD_DEFINITION",
        f"#:{kind}",
        *(f"D:{channel}" for channel in channels),
        "$",
        "$$$$$$$$$$$$",
    ]
    return "\n".join(header).encode("ascii") + b"\n" + _payload(np.asarray(columns, float), kind)


def _payload(columns: np.ndarray, kind: str) -> bytes:
    width, together = WIDTH[kind]
    if kind[0] == "K":
        # Records are filled one after the other, the last one padded with NaN.
        values = columns.ravel()
        values = np.concatenate([values, np.full(-values.size % together, np.nan)])
        return values.astype(f">f{width}").tobytes()
    lines = []
    for row in columns:
        # Every row of data begins a record of its own.
        for first in range(0, len(row), together):
            lines.append("".join(_number(v, width) for v in row[first : first + together]))
    return ("\n".join(lines) + "\n").encode("ascii")


def _number(value: float, width: int) -> str:
    text = "*missing*" if np.isnan(value) else f"{value:.{width - 4}f}"
    return text.rjust(width)[:width]
