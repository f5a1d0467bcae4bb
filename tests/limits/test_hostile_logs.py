"""Binary logs in which a library goes round in circles: given up after seconds, in one sentence."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from log_files import mdf4

from studies.process import processor_seconds
from sysid import limits
from sysid.campaign import Sensor, read_log
from sysid.errors import DataRejectedError

SENSORS = (Sensor("q_mm", "suspension_deflection", "mm", axle=0, full_scale=0.15),)


def test_the_time_of_a_reader_follows_the_size_of_its_file() -> None:
    """A file of 10 MB is given up within 10 s, a large one has the time that it takes."""
    assert limits.reader_seconds(0) == limits.READER_START_SECONDS
    assert limits.reader_seconds(10_000_000) <= 9.0
    assert limits.reader_seconds(limits.LOG_BYTES) == limits.READER_SECONDS


def test_an_mdf_file_whose_data_groups_form_a_circle(tmp_path: Path) -> None:
    """asammdf follows the links without an end (found by the fuzzer)."""
    pytest.importorskip("asammdf")
    raw = bytearray(mdf4())
    # The header block begins at 64; behind its head of 24 bytes stands the first data group, and in that the next one.
    (first,) = struct.unpack_from("<Q", raw, 64 + 24)
    struct.pack_into("<Q", raw, first + 24, first)
    (tmp_path / "log.mf4").write_bytes(raw)
    began = processor_seconds()
    with pytest.raises(DataRejectedError, match=r"log\.mf4 takes longer than 7 s to read; export it again"):
        read_log(tmp_path / "log.mf4", "log.mf4", SENSORS, 0.005)
    assert processor_seconds() - began < 10.0
