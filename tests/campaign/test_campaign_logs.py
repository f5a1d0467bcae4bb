"""The log reader: every dialect gives the same numbers, every fault ends in a warning or one sentence."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sysid.bounded_reader import end_readers
from sysid.campaign import Sensor, read_log
from sysid.campaign.inputs import logs
from sysid.campaign.inputs.logs import LogWriting
from sysid.errors import DataRejectedError
from sysid.logs.channels import Clock, LogContent, LogRequest, RawChannel
from sysid.logs.input_file import InputFile
from sysid.logs.registry import read_channels

SENSORS = (
    Sensor("q_mm", "suspension_deflection", "mm", axle=0, full_scale=0.15),
    Sensor("a_g", "axle_acceleration", "g", axle=0, full_scale=10 * 9.80665),
)
ROWS = [(0.00, 1.25, -0.5), (0.01, 2.5, 0.25), (0.02, -3.0, 1.0), (0.03, 0.5, -2.0), (0.04, 0.0, 0.75)]
HEADER = "time_s,q_mm,a_g"


def table(header: str = HEADER, rows=ROWS, delimiter: str = ",", decimal: str = ".", end: str = "\n") -> str:
    lines = [header.replace(",", delimiter)]
    lines += [delimiter.join(f"{v:.4f}".replace(".", decimal) for v in row) for row in rows]
    return end.join(lines) + end


def read(tmp_path: Path, content: str | bytes, sensors=SENSORS, step: float = 0.01):
    path = tmp_path / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_log(path, "log.csv", sensors, step)


def check_rows(log) -> None:
    q, a = log.channels
    assert q.time_s == pytest.approx([r[0] for r in ROWS], abs=1e-12)
    assert q.value == pytest.approx([r[1] * 1e-3 for r in ROWS], rel=1e-12)
    assert a.value == pytest.approx([r[2] * 9.80665 for r in ROWS], rel=1e-12)
    assert q.value.dtype == np.float64
    assert log.sample_interval_s == pytest.approx(0.01, rel=1e-9)


DIALECTS = {
    "comma": table(),
    "semicolon": table(delimiter=";"),
    "tab": table(delimiter="\t"),
    "decimal comma": table(delimiter=";", decimal=","),
    "decimal comma, tab": table(delimiter="\t", decimal=","),
    "windows lines": table(end="\r\n"),
    "old mac lines": table(end="\r"),
    "byte order mark": table().encode("utf-8-sig"),
    "utf-16": table().encode("utf-16"),
    "utf-16 big endian without mark": table().encode("utf-16-be"),
    "utf-16 little endian without mark": table().encode("utf-16-le"),
    "latin-1": table("time_s,q_mm,a_g,tmp").replace(",tmp", ",Öl °C").encode("latin-1"),
    "comments": "# truck 7\n% exported\n" + table(),
    "comment between rows": table().replace("\n0.02", "\n# gear\n0.02"),
    "preamble": "Logger 9000\nserial,4711\n\n" + table(),
    "quoted names": table('"time_s","q_mm","a_g"'),
    "quoted cells": table().replace("1.2500", '"1.2500"'),
    "spaces": table("time_s , q_mm , a_g").replace(",", ", "),
    "blank end": table() + "\n\n",
    "trailing delimiters": table().replace("\n", ",\n"),
    "time [s]": table("time [s],q_mm,a_g"),
    "Time": table("Time,q_mm,a_g"),
    "t": table("t,q_mm,a_g"),
    "milliseconds": table("time_ms,q_mm,a_g", [(1e3 * t, q, a) for t, q, a in ROWS]),
    "shuffled columns": "a_g,other,time_s,q_mm\n" + "".join(f"{a},x,{t},{q}\n" for t, q, a in ROWS),
    "exponents": "time_s,q_mm,a_g\n" + "".join(f"{t:e},{q:e},{a:E}\n" for t, q, a in ROWS),
    "late start": table(rows=[(t + 2718, q, a) for t, q, a in ROWS]),
    "no last line end": table().rstrip("\n"),
    "row of units": table().replace("a_g\n", "a_g\ns,mm,g\n"),
    "time in another language": table("zeit,q_mm,a_g"),
}


@pytest.mark.parametrize("content", DIALECTS.values(), ids=DIALECTS)
def test_every_dialect_gives_the_same_numbers(tmp_path, content):
    log = read(tmp_path, content)
    check_rows(log)
    assert log.messages == ()


def test_late_start_is_kept(tmp_path):
    assert read(tmp_path, DIALECTS["late start"]).start_time_s == pytest.approx(2718.0, abs=1e-9)


@pytest.mark.parametrize("cell", ["", " ", "nan", "NaN", "inf", "-Infinity", "1e999", "-", "n/a", "null"])
def test_cells_without_a_number_are_missing(tmp_path, cell):
    log = read(tmp_path, table().replace("2.5000", cell))
    assert np.isnan(log.channels[0].value[1])
    assert np.isfinite(log.channels[0].value).sum() == 4
    assert np.isfinite(log.channels[1].value).all()


def test_declared_range_is_censored(tmp_path):
    rows = [(0.01 * i, 0.0, a) for i, a in enumerate([0.0, 9.998, 10.0, -10.0, 12.0])]
    assert read(tmp_path, table(rows=rows)).channels[1].censored.tolist() == [0, 0, 1, -1, 1]


def test_dropped_rows_and_jitter_keep_their_stamps(tmp_path):
    stamps = [0.0, 0.0101, 0.02, 0.03, 0.0502, 0.06, 0.09]
    log = read(tmp_path, table(rows=[(t, 1.0, 1.0) for t in stamps]))
    assert log.channels[0].time_s == pytest.approx(stamps, abs=1e-12)
    assert log.duration_s == pytest.approx(0.09)


def test_a_repeated_stamp_is_left_out(tmp_path):
    rows = [(0.01 * i, i, 0.0) for i in range(10)]
    log = read(tmp_path, table(rows=[*rows[:5], (0.04, 99.0, 0.0), *rows[5:]]))
    assert log.channels[0].value == pytest.approx([1e-3 * i for i in range(10)])
    assert any("row 7" in m and "repeated" in m for m in log.messages)


def test_slow_log_is_read_with_a_message(tmp_path):
    log = read(tmp_path, table(rows=[(0.1 * i, i, 0.0) for i in range(8)]))
    assert log.sample_interval_s == pytest.approx(0.1)
    assert any("0.1 s apart" in m for m in log.messages)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (1e-9, "probably in ns; write them in seconds"),
        (1e-6, "probably in us; write them in seconds"),
        (1e-3, "probably in ms; name the column time_ms"),
        (60.0, "1/60 of the declared 0.005 s, so they are probably in minutes; write them in seconds"),
        (3600.0, "1/3600 of the declared 0.005 s, so they are probably in hours; write them in seconds"),
        (86400.0, "counts days"),
        (1 / 30.0, "30 times the declared 0.005 s; correct acquisition.sample_interval_s or write them in seconds"),
        (400.0, "1/400 of the declared 0.005 s; correct acquisition.sample_interval_s"),
    ],
)
@pytest.mark.parametrize("start_s", [0.0, 36_000.0])
def test_stamps_in_another_unit_are_refused(tmp_path, seconds, words, start_s):
    # A record of a minute: in a small unit it spans more than a log may.
    rows = "".join(f"{(start_s + 0.005 * i) / seconds:.12f},{i % 7},0\n" for i in range(12_000))
    with pytest.raises(DataRejectedError) as error:
        read(tmp_path, f"time,q_mm,a_g\n{rows}", step=0.005)
    assert words in str(error.value)


def test_a_clock_at_the_declared_rate_lets_others_be_far_from_it(monkeypatch) -> None:
    fast, slow = Clock("fast", 0.0002 * np.arange(4000)), Clock("slow", 0.02 * np.arange(40))
    channels = (RawChannel("q_mm", slow, np.arange(40.0), "mm"), RawChannel("a_g", fast, np.arange(4000.0), "g"))
    monkeypatch.setattr(logs, "read_channels", lambda *rest: LogContent(channels, ("q_mm", "a_g")))
    log = read_log(InputFile(Path("log.mf4"), b""), "log.mf4", SENSORS, 0.0002)
    assert [c.time_s.size for c in log.channels] == [40, 4000]


def test_missing_sensor_column_leaves_its_channel_out(tmp_path):
    log = read(tmp_path, table("time_s,q_mm,a_G"))
    assert [c.sensor.column for c in log.channels] == ["q_mm"]
    assert "'a_g' is missing (the file has 'a_G')" in log.messages[0]


def test_left_and_right_are_averaged(tmp_path):
    sensors = [
        Sensor("l_mm", "suspension_deflection", "mm", axle=0, side="left", full_scale=0.1),
        Sensor("r_cm", "suspension_deflection", "cm", axle=0, side="right", full_scale=0.1),
        Sensor("a_g", "axle_acceleration", "g", axle=0),
    ]
    wave = 20.0 * np.sin(np.arange(60) / 5.0)
    rows = [(0.01 * i, w + 1.0, 0.1 * w - 0.1, 0.0) for i, w in enumerate(wave)]
    log = read(tmp_path, table("time_s,l_mm,r_cm,a_g", rows), sensors)
    assert [c.sensor.column for c in log.channels] == ["l_mm+r_cm", "a_g"]
    assert log.channels[0].sensor.side is None
    assert log.channels[0].value == pytest.approx(1e-3 * wave, abs=2e-6)
    assert log.messages == ()
    opposite = [(t, left, -right, a) for t, left, right, a in rows]
    assert any("left and right" in m for m in read(tmp_path, table("time_s,l_mm,r_cm,a_g", opposite), sensors).messages)
    dead = [(t, left, 0.0, a) for t, left, _, a in rows]
    log = read(tmp_path, table("time_s,l_mm,r_cm,a_g", dead), sensors)
    assert log.channels[0].sensor.column == "l_mm"
    assert any("only 'l_mm' is used" in m for m in log.messages)


def _times(stamps) -> str:
    return table(rows=[(t, 1.0, 1.0) for t in stamps])


FAULTS = {
    "empty": (b"", ["is empty"]),
    "only NUL": (b"\0" * 500, ["is empty"]),
    "only blank": (" \n \n", ["is empty"]),
    "binary": (bytes(range(256)) * 40, ["log.csv"]),
    "MDF": (b"MDF     4.10" + b"\1" * 100, ["an MDF file", "damaged"]),
    "zip": (b"PK\x03\x04" + b"\0" * 100, ["Excel", "damaged"]),
    "NUL in a row": (table().replace("2.5000", "2\0005"), ["line 3", "NUL"]),
    "NUL block at the end": (table().encode() + b"\0" * 4096, ["line 7", "NUL"]),
    "header only": (HEADER + "\n", ["log.csv"]),
    "one row": (table(rows=ROWS[:1]), ["1 row"]),
    "no header": (table().split("\n", 1)[1], ["no header line"]),
    "other columns": ("a,b\n1,2\n", ["none of the columns", "'a'"]),
    "no time column": (table("when,q_mm,a_g"), ["no time column", "'time_s'"]),
    "no sensor column": (table("time_s,x,y"), ["none of the sensor columns", "'q_mm'"]),
    "duplicate header": (table("time_s,q_mm,q_mm"), ["'q_mm'", "columns 2 and 3"]),
    "duplicate time": (table("time_s,time_s,a_g"), ["'time_s' (column 1) and 'time_s' (column 2)", "side by side"]),
    "text in a cell": (table().replace("-3.0000", "out"), ["row 4", "'q_mm'", "'out'", "expected a number"]),
    "date for time": (table().replace("0.0000,1.25", "2024-05-01 10:00,1.25"), ["row 2", "'time_s'", "2024"]),
    "some decimal commas": (table().replace("2.5000", '"2,5"'), ["row 3", "'2,5'", "decimal point"]),
    "comma for both": (table(decimal=","), ["row 2", "semicolons"]),
    "too many cells": (table().replace("2.5000", "2,5,0"), ["row 3"]),
    "open quote": (table().replace("2.5000", '"2.5'), ["log.csv"]),
    "backward": (_times([0.0, 0.01, 0.02, 0.015, 0.03]), ["runs backward in row 5", "0.02 s to 0.015 s"]),
    "midnight": (
        _times([86399.98, 86399.99, 0.0, 0.01]),
        ["runs backward in row 4", "add 86400 s", "from that row on"],
    ),
    "constant time": (_times([1.0] * 9), ["repeat"]),
    "coarse stamps": (_times([0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.2, 0.2]), ["repeat", "row 3", "more digits"]),
    "empty time": (HEADER + "\n0.0,1,1\n" + ",1,1\n" * 9 + "0.1,1,1\n", ["9 of 11 rows", "row 3"]),
    "milliseconds called seconds": (_times([0.0, 10.0, 20.0, 30.0]), ["probably in ms", "time_ms"]),
    "too many columns": (
        ",".join(["time_s", "q_mm", *(f"c{i}" for i in range(10_000))]) + "\n0,1\n",
        ["10002 columns"],
    ),
    "too many other columns": (",".join(f"c{i}" for i in range(10_000)) + "\n", ["10000 columns"]),
}


def processor_seconds() -> float:
    """Processor time of this process and of those that it has waited for: a busy machine is no slow reader."""
    end_readers()
    return sum(os.times()[:4])


@pytest.mark.parametrize(("content", "words"), FAULTS.values(), ids=FAULTS)
def test_faulty_log_ends_in_one_sentence(tmp_path, content, words):
    started = processor_seconds()
    with pytest.raises(DataRejectedError) as error:
        read(tmp_path, content)
    text = str(error.value)
    assert "\n" not in text
    assert text.endswith(".")
    assert text.startswith("log.csv")
    assert len(text) < 500
    for word in words:
        assert word in text
    assert processor_seconds() - started < 2.0


def test_empty_time_cells_inside_are_left_out_when_few(tmp_path):
    rows = [(0.01 * i, i, 0.0) for i in range(20)]
    content = table(rows=rows).replace("0.0500,5.0000", ",5.0000")
    log = read(tmp_path, content)
    assert log.channels[0].value.size == 19
    assert any("without a time stamp" in m for m in log.messages)


@pytest.mark.parametrize("name", ["=cmd()", "<script>", "a\tb", "{x}", "%s", "\U0001f69a" * 30, "x" * 5000])
def test_hostile_column_names(tmp_path, name):
    sensors = (Sensor(name.strip(), "axle_acceleration", "g", axle=0), SENSORS[0])
    log = read(tmp_path, "time_s;q_mm\n0;1\n0.01;2\n0.02;1\n", sensors)
    assert len(log.channels) == 1
    assert all("\n" not in m and len(m) < 300 for m in log.messages)


@settings(
    max_examples=150, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.sampled_from(["comma", "decimal comma", "utf-16", "quoted cells", "comments"]),
    st.integers(0, 200),
    st.integers(0, 60),
    st.binary(max_size=20),
)
def test_damaged_log_never_ends_in_a_traceback(tmp_path, dialect, start, length, junk):
    content = DIALECTS[dialect]
    raw = content if isinstance(content, bytes) else content.encode()
    with contextlib.suppress(DataRejectedError):
        log = read(tmp_path, raw[:start] + junk + raw[start + length :])
        assert all(np.all(np.diff(c.time_s) > 0.0) for c in log.channels)


@settings(
    max_examples=150, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.text(alphabet="0123456789.,;\t\n\r\"'#eE+-naif tqm_sg\x00\x85\u2028", max_size=200), st.booleans())
def test_arbitrary_text_never_ends_in_a_traceback(tmp_path, text, with_header):
    with contextlib.suppress(DataRejectedError):
        read(tmp_path, (HEADER + "\n" if with_header else "") + text)


def test_the_rate_of_a_common_signal_is_not_that_of_the_log(monkeypatch) -> None:
    fast, slow = Clock("fast", 0.005 * np.arange(400)), Clock("slow", 0.1 * np.arange(20))
    channels = (RawChannel("q", fast, np.zeros(400), "mm"), RawChannel("pulse", slow, np.zeros(20), ""))
    monkeypatch.setattr(logs, "read_channels", lambda *rest: LogContent(channels, ("q", "pulse")))
    q = Sensor("q", "suspension_deflection", "mm", axle=0)
    log = read_log(InputFile(Path("log.mf4"), b""), "log.mf4", (q,), 0.005, LogWriting(sync="pulse"))
    assert log.sample_interval_s == pytest.approx(0.005)
    assert not any("different rates" in message for message in log.messages)
    assert log.sync[0].size == 20


@pytest.mark.parametrize("text", ["when,x\n0,1\n1,2\n", "0,1\n1,2\n"])
def test_a_table_without_time_of_which_everything_is_asked_names_what_it_lacks(text: str) -> None:
    with pytest.raises(DataRejectedError, match=r"(no column of time|no header line).*expected time_s and columns of"):
        read_channels(InputFile(Path("log.csv"), text.encode()), "log.csv", LogRequest((), everything=True))
