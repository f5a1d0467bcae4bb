"""Every format gives what its CSV twin gives; a damaged file gives numbers or one sentence, soon."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from log_files import FILES, STEP_S, csv, readings

from sysid.bounded_reader import end_readers
from sysid.campaign import Sensor, read_log
from sysid.errors import SysidError
from sysid.logs.channels import LogRequest
from sysid.logs.input_file import InputFile
from sysid.logs.registry import FORMATS, format_of, read_channels
from sysid.logs.selection import FileChannel, RefusedError, selected

SENSORS = (
    Sensor("q_mm", "suspension_deflection", "mm", axle=0),
    Sensor("a_g", "axle_acceleration", "g", axle=0),
    Sensor("b_g", "body_acceleration", "g", body=0, x_m=0.0),
)
SEED = 20_240_501
FLIPS = 200


def read(name: str, data: bytes, sensors=SENSORS):
    return read_log(InputFile(Path(name), data), name, sensors, STEP_S)


@pytest.mark.parametrize(("name", "written", "digits"), FILES.values(), ids=FILES)
def test_a_format_gives_what_its_csv_twin_gives(name: str, written, digits: float) -> None:
    log, twin = read(name, written()), read("log.csv", csv())
    assert [c.sensor.column for c in log.channels] == ["q_mm", "a_g", "b_g"]
    assert log.messages == ()
    assert log.sample_interval_s == STEP_S
    for channel, expected in zip(log.channels, twin.channels, strict=True):
        np.testing.assert_allclose(channel.time_s, expected.time_s, rtol=digits, atol=0.0)
        np.testing.assert_allclose(channel.value, expected.value, rtol=digits, atol=0.0)
    np.testing.assert_array_equal(twin.channels[0].value, readings()["q_mm"] * 1e-3)


@pytest.mark.parametrize(("name", "written", "digits"), FILES.values(), ids=FILES)
def test_content_decides_before_the_suffix(name: str, written, digits: float) -> None:
    head = written()
    expected = format_of(InputFile(Path(name), head)).name
    # MAT 4 has no mark of its own.
    if name != "log.mat" or head.startswith(b"MATLAB"):
        assert format_of(InputFile(Path("log.bin"), head)).name == expected
    assert expected in {f.name for f in FORMATS} - {"csv"}


def damaged(data: bytes, flips: int) -> list[bytes]:
    """The file cut at eight places, and with single bits turned: half of them in its first thousand bytes."""
    generator = np.random.default_rng(SEED)
    cut = [data[: int(share * len(data))] for share in (0.001, 0.02, 0.1, 0.3, 0.5, 0.8, 0.95, 0.999)]
    result = cut if flips >= 8 else cut[:: len(cut) // flips]
    for k in range(flips):
        at = int(generator.integers(0, len(data) if k % 2 else min(len(data), 1000)))
        turned = bytearray(data)
        turned[at] ^= 1 << int(generator.integers(0, 8))
        result.append(bytes(turned))
    return result


def refusals(name: str, files: list[bytes]) -> list[str]:
    """Sentences of the files that are refused; anything but a sentence fails."""
    said = []
    for data in files:
        try:
            log = read(name, data)
            assert all(np.all(np.diff(c.time_s) > 0.0) for c in log.channels)
        except SysidError as error:
            text = str(error)
            assert "\n" not in text, text
            assert text.startswith("log."), text
            assert text.endswith((".", "?")), text
            assert len(text) < 700, text
            assert "Traceback" not in text
            said.append(text)
    return said


@pytest.mark.parametrize(("name", "written", "digits"), FILES.values(), ids=FILES)
def test_damaged_files_end_in_a_sentence(name: str, written, digits: float) -> None:
    assert refusals(name, damaged(written(), 4))


def processor_s() -> float:
    """Processor time of this process and of the children that it has waited for [s]: other work does not count."""
    end_readers()
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.mark.long
@pytest.mark.parametrize(("name", "written", "digits"), FILES.values(), ids=FILES)
def test_two_hundred_flips_take_less_than_two_seconds_each(name: str, written, digits: float) -> None:
    files = damaged(written(), FLIPS)
    begin = processor_s()
    assert refusals(name, files)
    assert processor_s() - begin < 2.0 * len(files)


@pytest.mark.parametrize(("name", "written", "digits"), FILES.values(), ids=FILES)
def test_all_channels_can_be_asked_for_without_their_names(name: str, written, digits: float) -> None:
    content = read_channels(InputFile(Path(name), written()), name, LogRequest((), everything=True))
    expected = readings()
    # HDF5 lists its data sets by the alphabet.
    assert sorted(c.name for c in content.channels) == ["a_g", "b_g", "q_mm"]
    for channel in content.channels:
        np.testing.assert_allclose(channel.values, expected[channel.name], rtol=digits, atol=0.0)
        np.testing.assert_allclose(channel.clock.time_s, expected["time_s"], rtol=digits, atol=1e-12)


def test_of_all_channels_those_of_one_name_have_their_groups_and_text_is_left_out() -> None:
    values, time = np.arange(4.0), lambda: STEP_S * np.arange(4.0)
    found = [
        FileChannel("a", 4, lambda: (values, "g"), "front", time, "clock"),
        FileChannel("a", 4, lambda: (2.0 * values, "g"), "rear", time, "clock"),
        FileChannel("note", 4, lambda: (np.array(list("text")), None), "front", time, "clock"),
        FileChannel("q", 4, lambda: (3.0 * values, "mm"), "rear", time, "clock"),
    ]
    request = {"wanted": (), "time": None, "everything": True}
    answer, arrays = selected(found, request)
    assert answer["wanted"] == ["front/a", "rear/a", "q"]
    assert [list(a) for a in arrays[1:]] == [list(values), list(2.0 * values), list(3.0 * values)]
    assert len(answer["clocks"]) == 1
    with pytest.raises(RefusedError, match="text or dates"):
        selected(found[2:3], request)
