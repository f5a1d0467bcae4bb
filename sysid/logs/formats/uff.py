"""Universal files, data set 58 and 58b, by pyuff: functions of time, each with its own abscissa."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError, axis_seconds, not_time
from sysid.logs.names import decoded

_HEAD = re.compile(rb"^\s*-1[ \t]*\r?\n\s{0,5}(15|55|58b?|82|15[01]|164|18|1858|24\d\d)\b")
#: Lines of text of a data set 58 from its number on, before its numbers.
_TEXT_LINES = 12
#: Kinds of abscissa (data set 58, record 8): 0 and 1 leave it to the label; 17 is time.
_UNSAID, _TIME = (0, 1), 17
_AXES = {2: "stress", 3: "strain", 5: "temperature", 8: "displacement", 9: "force", 11: "velocity", 12: "acceleration",
         13: "force", 15: "pressure", 16: "mass", 18: "frequency", 19: "rpm", 20: "order"}  # fmt: skip
#: Directions of a node (record 6).
_DIRECTIONS = {0: "", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z", 4: "+RX", -4: "-RX", 5: "+RY",
               -5: "-RY", 6: "+RZ", -6: "-RZ"}  # fmt: skip
#: Data sets that describe the model and its units.
_DESCRIPTIONS = (15, 18, 82, 150, 151, 164, 1858, 2411, 2412, 2420)


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Functions by the name in their first line, else by node and direction, such as ``12+Z``.

    Functions of one name can be told apart by node and direction, as in ``12+Z/NAME``.

    Raises
    ------
    RefusedError
        If there is no data set 58, or the file is cut.
    """
    import pyuff

    data = stream.read()
    if not data[-200:].rstrip(b"\0\x1a \t\r\n").endswith(b"-1"):
        raise RefusedError("is a universal file that ends before its data do; copy or export it again")
    with tempfile.TemporaryDirectory() as folder:
        # The library takes a path; this file holds the bytes that were hashed.
        path = os.path.join(folder, "log.uff")
        with open(path, "wb") as copy:
            copy.write(_in_utf8(data))
        file = pyuff.UFF(path)
        kinds = [int(kind) for kind in file.get_set_types()]
        sets = [file.read_sets(n) for n, kind in enumerate(kinds) if kind == 58]
    if not sets:
        raise RefusedError("has no data set 58; export the time histories as universal file 58")
    others = sorted({kind for kind in kinds if kind != 58 and kind not in _DESCRIPTIONS})
    if others:
        count = sum(kind in others for kind in kinds)
        shown = ", ".join(map(str, others[:6]))
        request["messages"].append(f"{count} data sets that are no functions of time are not read (kinds {shown})")
    for one in sets:
        yield _file_channel(one)


def _in_utf8(data: bytes) -> bytes:
    """The file with the text of its data sets 58 in UTF-8, which the library takes for granted."""
    pieces: list[bytes] = []
    done = 0
    begin = data.find(b"    58")
    while begin >= 0:
        end = begin
        if data[max(0, begin - 82) : begin].rstrip().endswith(b"    -1"):
            for _ in range(_TEXT_LINES):
                end = data.find(b"\n", end) + 1 or len(data)
            text = data[begin:end]
            if not text.isascii():
                pieces += [data[done:begin], decoded(text).encode()]
                done = end
        begin = data.find(b"    58", max(end, begin + 1))
    return b"".join([*pieces, data[done:]]) if pieces else data


def _file_channel(one: dict[str, Any]) -> FileChannel:
    place = f"{one.get('rsp_node', 0)}{_DIRECTIONS.get(int(one.get('rsp_dir', 0)), '')}"
    label = str(one.get("id1", "")).strip()
    named = label and label.upper() != "NONE"
    count = int(one["num_pts"])
    return FileChannel(
        label if named else place,
        count,
        partial(_load, one, count),
        place if named else "",
        partial(_time, one, count, label if named else place),
        "abscissa",
    )


def _load(one: dict[str, Any], count: int) -> tuple[np.ndarray, str | None]:
    """Values and unit; the library takes bytes of line ends behind binary data for values."""
    values = np.asarray(one["data"])
    if values.size < count:
        raise RefusedError(f"has {values.size} of {count} values in a data set 58; copy or export it again")
    return values[:count], _label(one, "ordinate_axis_units_lab")


def _time(one: dict[str, Any], count: int, name: str) -> np.ndarray:
    kind = int(one.get("abscissa_spec_data_type", _TIME))
    unit = _label(one, "abscissa_axis_units_lab")
    if kind != _TIME and kind not in _UNSAID:
        raise not_time(_AXES.get(kind, f"of kind {kind}"), unit or "", name)
    what = "time" if kind == _TIME else _label(one, "abscissa_axis_lab") or ""
    factor, axis = axis_seconds(what, unit, name), np.asarray(one["x"], np.float64)[:count]
    return axis if factor == 1.0 else axis * factor


def _label(one: dict[str, Any], key: str) -> str | None:
    text = str(one.get(key, "")).strip()
    return None if text.upper() in ("", "NONE") else text


FORMAT = library_format(
    "uff",
    "a universal file",
    __name__,
    suffixes=(".uff", ".unv", ".uf", ".u58"),
    recognises=lambda head: _HEAD.match(head) is not None,
    libraries=("pyuff",),
    extra="uff",
)
