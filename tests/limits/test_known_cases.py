"""Files that once took gigabytes or had no end, each read in a process of its own: one sentence, 2 s, 500 MB."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from measured_read import MOST_BYTES, MOST_SECONDS, measured
from small_campaign import CAMPAIGN


def las_with_records(folder: Path) -> bytes:
    cloud = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    cloud.x = cloud.y = cloud.z = np.arange(40.0)
    cloud.write(str(folder / "good.las"))
    raw = bytearray((folder / "good.las").read_bytes())
    struct.pack_into("<I", raw, 100, 4_000_000_000)
    return bytes(raw)


def las_compressed_with_records(folder: Path) -> bytes:
    raw = bytearray(las_with_records(folder))
    raw[104] |= 0x80
    return bytes(raw)


def ply_of_wide_rows(folder: Path) -> bytes:
    head = ["ply", "format ascii 1.0", "element vertex 1000000", *(f"property float {axis}" for axis in "xyz")]
    head += [f"property double p{i}" for i in range(1000)]
    return "\n".join([*head, "end_header", "1 2 3\n" * 200_000]).encode()


def drop_with_jump(folder: Path) -> bytes:
    time = 0.01 * np.arange(2000)
    value = 20.0 * np.exp(-time) * np.cos(9.0 * time)
    time[1500:] += 1e9
    return ("time_s,q_mm\n" + "".join(f"{t:.4f},{q:.4f}\n" for t, q in zip(time, value, strict=True))).encode()


def scan_of_huge_coordinates(folder: Path) -> bytes:
    points = 1e300 * np.random.default_rng(0).random((500, 3))
    return ("x,y,z\n" + "".join(f"{x},{y},{z}\n" for x, y, z in points)).encode()


def key_of_parts(parts: int) -> Callable[[Path], bytes]:
    return lambda folder: (CAMPAIGN + ".".join(["a"] * parts) + " = 1\n").encode()


def fixed(content: bytes) -> Callable[[Path], bytes]:
    return lambda folder: content


CASES: dict[str, tuple[str, Callable[[Path], bytes], str]] = {
    "LAS, 4e9 further records": ("cloud", las_with_records, "announces 4000000000 further records"),
    "LAZ, 4e9 further records": ("cloud", las_compressed_with_records, "announces 4000000000 further records"),
    "PLY, rows of 8 kB": ("cloud", ply_of_wide_rows, "not every vertex has 1003 numbers"),
    "100 MB of blank lines, scan": ("cloud", fixed(b"x,y,z\n" + b"\n" * 100_000_000), "holds no rows of numbers"),
    "100 MB of blank lines in between": (
        "cloud", fixed(b"x,y,z\n1,2,3\n" + b"\n" * 100_000_000 + b"1,2,3\n"), "lines, at most"),
    "100 MB of blank lines, log": (
        "log", fixed(b"time_s,q_mm,a_g\n" + b"\n" * 100_000_000), "lines, at most 3000000 rows are read"),
    "open quotation mark": ("cloud", fixed(b'x,y,z\n1,2,"3\n' + b"1,2,3\n" * 500_000), "never closed"),
    "key of 20,000 parts": ("campaign", key_of_parts(20_000), "more than 8 parts"),
    "key of 200,000 parts": ("campaign", key_of_parts(200_000), "more than 8 parts"),
    "39,000 unknown keys": (
        "campaign", fixed((CAMPAIGN + "".join(f"k{i} = 1\n" for i in range(39_000))).encode()), "and 38997 more"),
    "text of 100,000 blanks for a list": (
        "campaign", fixed(CAMPAIGN.replace("[4000, 3500]", f"'1{' ' * 100_000}x'").encode()), "a list"),
    "clock that jumps by 30 years": ("drop", drop_with_jump, "jumps by 1e+09 s in row 1502"),
    "scan points of 1e300": ("scan", scan_of_huge_coordinates, "no point with three numbers"),
}  # fmt: skip


@pytest.mark.parametrize(("reader", "make", "said"), CASES.values(), ids=CASES)
def test_a_known_case_is_one_sentence_in_little_time_and_memory(
    reader: str, make: Callable[[Path], bytes], said: str, tmp_path: Path
) -> None:
    path = tmp_path / ("campaign.toml" if reader == "campaign" else "file.csv")
    path.write_bytes(make(tmp_path))
    found = measured(reader, path)
    assert found.kind in ("CampaignError", "DataRejectedError"), found.text
    assert said in found.text
    assert "\n" not in found.text
    assert found.seconds <= MOST_SECONDS
    assert found.bytes <= MOST_BYTES


@pytest.mark.long
def test_the_largest_scan_that_is_read_stays_within_the_memory(tmp_path: Path) -> None:
    path = tmp_path / "scan.csv"
    path.write_bytes(b"x,y,z\n" + b"1.2345678,2.2345678,3.2345678\n" * 4_000_000)
    found = measured("cloud", path)
    assert (found.kind, found.text) == ("read", "")
    assert found.bytes <= MOST_BYTES
