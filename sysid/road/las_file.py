"""Points of LAS files: uncompressed ones are read from their header, compressed ones (LAZ) by laspy in a child process.

Header of LAS 1.0 to 1.4 as in the ASPRS LAS Specification 1.4 R15, table 3; every point record begins with X, Y and Z
as 32-bit integers.  The variable-length records between header and points, of which a header can promise billions, are
not needed.
"""

from __future__ import annotations

import re
import struct

import numpy as np

from sysid.bounded_reader import read_in_child
from sysid.errors import DataRejectedError
from sysid.road.cloud_libraries import read_las

#: Lengths of the header, of versions up to 1.2 and of 1.4.
_HEADER_BYTES, _HEADER_BYTES_1_4 = 227, 375
#: Shortest record of point formats 0 to 10.
_RECORD_BYTES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
#: Bits of the point format that LASzip sets.
_COMPRESSED = 0x80 | 0x40
#: Headers of records of variable length, and of extended ones.
_VLR_BYTES, _EVLR_BYTES = 54, 60
#: Records that are searched for the coordinate system.
_MOST_RECORDS = 1000
#: Metres in units by their numbers in the EPSG data set: metre, foot, US survey foot.
_EPSG_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0}
#: Units of length, not of angle, in the text of a coordinate system.
_WKT_UNIT = re.compile(r'(?:LENGTHUNIT|UNIT)\["(?:metre|meter|[^"]*(?:foot|feet))[^"]*",\s*([\d.]+)', re.IGNORECASE)


def las_points(data: bytes, label: str, most_points: int) -> np.ndarray:
    """Coordinates (n, 3) float64 of a LAS or LAZ file in its unit: X times scale plus offset.

    Raises
    ------
    DataRejectedError
        If the header does not fit the file, there are no points or more than `most_points`, or the file is compressed
        and no decompressor is installed.
    """
    if len(data) < _HEADER_BYTES:
        raise _unreadable(label, "it ends within its header")
    minor = data[25]
    header_bytes, begin, records, kind, size, count = struct.unpack_from("<HIIBHI", data, 94)
    scale, offset = np.frombuffer(data, "<f8", 6, 131).reshape(2, 3)
    extended = 0
    if minor >= 4:
        if len(data) < _HEADER_BYTES_1_4:
            raise _unreadable(label, "it ends within its header")
        extended, count = struct.unpack_from("<IQ", data, 243)
    if header_bytes < _HEADER_BYTES or not header_bytes <= begin <= len(data):
        raise _unreadable(label, "the place of its points is outside the file")
    if records * _VLR_BYTES > begin - header_bytes or extended * _EVLR_BYTES > len(data):
        raise _unreadable(label, f"it announces {records + extended} further records for which it has no room")
    if kind & 0x3F >= len(_RECORD_BYTES) or size < _RECORD_BYTES[kind & 0x3F]:
        raise _unreadable(label, f"it has points of format {kind & 0x3F} with {size} bytes each")
    check_count(label, count, most_points)
    if kind & _COMPRESSED:
        return _decompressed(data, label, most_points)
    if begin + count * size > len(data):
        raise DataRejectedError(f"{label} announces {count} points but is cut short; copy or export it again.")
    layout = np.dtype({"names": ["xyz"], "formats": ["(3,)<i4"], "offsets": [0], "itemsize": size})
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.frombuffer(data, layout, count, begin)["xyz"] * scale + offset)


def las_units(data: bytes) -> tuple[float, ...]:
    """Metres in the units that the coordinate system of a LAS file names, empty where it names none.

    From the GeoKeyDirectory (record 34735; keys 3076 and 4099 of GeoTIFF 1.0, horizontal and vertical unit) or from the
    last units of length in the text of record 2112 (OGC WKT).
    """
    (begin, _, records) = struct.unpack_from("<HII", data, 94)
    found: list[float] = []
    for _ in range(min(records, _MOST_RECORDS)):
        if begin + _VLR_BYTES > len(data):
            break
        owner, number, size = struct.unpack_from("<16sHH", data, begin + 2)
        content = data[begin + _VLR_BYTES : begin + _VLR_BYTES + size]
        if owner.rstrip(b"\0") == b"LASF_Projection" and number == 34735:
            keys = np.frombuffer(content[: size // 8 * 8], "<u2").reshape(-1, 4)[1:]
            found += [
                _EPSG_UNITS[int(v)] for k, where, _, v in keys if k in (3076, 4099) and not where and v in _EPSG_UNITS
            ]
        elif owner.rstrip(b"\0") == b"LASF_Projection" and number == 2112:
            text = content.decode("utf-8", "replace")
            found += [float(size) for size in _WKT_UNIT.findall(text)]
        begin += _VLR_BYTES + size
    return tuple(found)


def _decompressed(data: bytes, label: str, most_points: int) -> np.ndarray:
    answer, arrays = read_in_child(read_las, data, label, ["laspy"], most_points=most_points)
    text = str(answer.get("text", ""))
    if "backend" in text.lower():
        raise DataRejectedError(
            f"{label} is compressed (LAZ) and no decompressor is installed; install 'lazrs' or export the cloud as LAS."
        )
    if "error" in answer:
        raise _unreadable(label, text.partition("\n")[0][:160] or answer["error"])
    check_count(label, answer.get("points", len(arrays[0])), most_points)
    return arrays[0]


def check_count(label: str, count: int, most_points: int) -> None:
    """Refuse a cloud without points, or with more than are read.

    Raises
    ------
    DataRejectedError
        In these two cases.
    """
    if count > most_points:
        raise DataRejectedError(
            f"{label} has {count} points, more than the {most_points} that are read; crop the cloud to a few metres "
            "around the bump or thin it."
        )
    if count == 0:
        raise DataRejectedError(f"{label} holds no points; check the export of the scanner.")


def _unreadable(label: str, reason: str) -> DataRejectedError:
    return DataRejectedError(f"{label} is not a readable LAS file ({reason}); export it again.")
