"""Universal files, data set 58 and 58b, by pyuff: functions of time, each with its own abscissa."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.selection import FileChannel, RefusedError

_HEAD = re.compile(rb"^\s*-1[ \t]*\r?\n\s{0,5}(15|55|58b?|82|15[01]|164|18|1858|24\d\d)\b")
#: Kind of abscissa that is time, and directions of a node (data set 58, records 6 and 8).
_TIME = 17
_DIRECTIONS = {0: "", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z", 4: "+RX", -4: "-RX", 5: "+RY",
               -5: "-RY", 6: "+RZ", -6: "-RZ"}  # fmt: skip


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Functions over time by the name in their first line, else by node and direction, such as ``12+Z``.

    Raises
    ------
    RefusedError
        If there is no data set 58.
    """
    import pyuff

    with tempfile.TemporaryDirectory() as folder:
        # The library takes a path; this file holds the bytes that were hashed.
        path = os.path.join(folder, "log.uff")
        with open(path, "wb") as copy:
            copy.write(stream.read())
        file = pyuff.UFF(path)
        sets = [file.read_sets(n) for n, kind in enumerate(file.get_set_types()) if str(kind).startswith("58")]
    if not sets:
        raise RefusedError("has no data set 58; export the time histories as universal file 58")
    for one in sets:
        if int(one.get("abscissa_spec_data_type", _TIME)) == _TIME:
            yield _file_channel(one)


def _file_channel(one: dict[str, Any]) -> FileChannel:
    values, time = np.asarray(one["data"]), np.asarray(one["x"], np.float64)
    label = str(one.get("id1", "")).strip()
    if not label or label.upper() == "NONE":
        label = f"{one.get('rsp_node', 0)}{_DIRECTIONS.get(int(one.get('rsp_dir', 0)), '')}"
    unit = str(one.get("ordinate_axis_units_lab", "")).strip()
    unit_or_none = None if unit.upper() == "NONE" else unit
    # Equal steps and sizes make one clock of two data sets.
    clock = f"abscissa {time.size} {time[:1].tolist()} {time[-1:].tolist()}"
    return FileChannel(label, values.size, lambda: (values, unit_or_none), time=lambda: time, clock=clock)


FORMAT = library_format(
    "uff",
    "a universal file",
    __name__,
    suffixes=(".uff", ".unv", ".uf", ".u58"),
    recognises=lambda head: _HEAD.match(head) is not None,
    libraries=("pyuff",),
    extra="uff",
)
