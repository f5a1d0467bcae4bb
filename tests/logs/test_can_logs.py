"""Logs of a CAN bus: written by python-can's own writers, packed here by hand, read with a small database."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign.inputs.logs import LogWriting, read_log
from sysid.campaign.records import Sensor
from sysid.errors import DataRejectedError
from sysid.logs.channels import LogRequest
from sysid.logs.input_file import InputFile
from sysid.logs.registry import format_of, read_channels

can = pytest.importorskip("can")
pytest.importorskip("cantools")

#: Two messages of plain signals, one with a multiplexer, and one of SAE J1939 sent by anybody (FE).
DATABASE = """VERSION ""
NS_ :
BS_:
BU_: BOX
BO_ 256 AXLE_1: 4 BOX
 SG_ q_mm : 0|16@1- (0.01,0) [-327|327] "mm" BOX
 SG_ a_g : 16|16@1- (0.001,0) [-32|32] "g" BOX
BO_ 257 BODY: 2 BOX
 SG_ b_g : 7|16@0- (0.0005,0) [-16|16] "g" BOX
BO_ 258 SLOW: 3 BOX
 SG_ which M : 0|8@1+ (1,0) [0|1] "" BOX
 SG_ oil_C m0 : 8|16@1- (0.1,0) [-100|300] "degC" BOX
 SG_ air_C m1 : 8|16@1- (0.1,0) [-100|300] "degC" BOX
BO_ 2566844926 CCVS: 8 BOX
 SG_ speed_km_h : 8|16@1+ (0.00390625,0) [0|250] "km/h" BOX
"""
ROWS = 200
TIME_S = 0.005 * np.arange(ROWS)
Q_MM = np.round(20.0 * np.exp(-2.0 * TIME_S) * np.cos(9.0 * TIME_S), 2)
A_G = np.round(0.5 * np.exp(-2.0 * TIME_S) * np.sin(60.0 * TIME_S), 3)
B_G = np.round(0.1 * np.sin(9.0 * TIME_S) * 2000.0) / 2000.0
START_S = 1_700_000_000.0


def frames() -> list:
    """Frames in the order of time; body and axle are sampled at different moments."""

    def frame(time: float, identifier: int, data: bytes, extended: bool = False):
        return can.Message(timestamp=START_S + time, arbitration_id=identifier, data=data, is_extended_id=extended)

    made = []
    for k, time in enumerate(TIME_S):
        made.append(frame(time, 256, struct.pack("<hh", round(100 * Q_MM[k]), round(1000 * A_G[k]))))
        made.append(frame(time + 0.002, 257, struct.pack(">h", round(2000 * B_G[k]))))
        if k % 20 == 0:
            made.append(frame(time + 0.003, 258, struct.pack("<Bh", k // 20 % 2, 900 + k)))
            # Priority 6 and source 0x21 instead of those of the database.
            speed = struct.pack("<BH5x", 255, round(256 * 16.0))
            made.append(frame(time + 0.004, 0x18FEF121, speed, True))
    made.append(can.Message(timestamp=START_S + 1.0, is_error_frame=True))
    return made


def blf() -> bytes:
    stream = io.BytesIO()
    stream.close = lambda: None  # type: ignore[method-assign]
    with can.BLFWriter(stream) as writer:
        for message in frames():
            writer(message)
    return stream.getvalue()


def asc() -> bytes:
    stream = io.StringIO()
    stream.close = lambda: None  # type: ignore[method-assign]
    with can.ASCWriter(stream) as writer:
        for message in frames():
            writer(message)
    return stream.getvalue().encode()


WRITTEN = [pytest.param(blf, "log.blf", id="blf"), pytest.param(asc, "log.asc", id="asc")]


@pytest.mark.parametrize(("written", "name"), WRITTEN)
def test_signals_are_those_that_were_packed(written: Callable[[], bytes], name: str):
    file = InputFile(Path(name), written())
    assert format_of(file).name == "can"
    assert format_of(InputFile(Path("log.csv"), file.data)).name == "can"
    wanted = ("q_mm", "a_g", "b_g", "oil_C", "speed_km_h")
    content = read_channels(file, name, LogRequest(wanted, database=DATABASE))
    found = {c.name: c for c in content.channels}
    assert {n: c.unit for n, c in found.items()} == {
        "q_mm": "mm", "a_g": "g", "b_g": "g", "oil_C": "degC", "speed_km_h": "km/h"
    }  # fmt: skip
    assert found["q_mm"].values == pytest.approx(Q_MM, abs=1e-9)
    assert found["a_g"].values == pytest.approx(A_G, abs=1e-9)
    assert found["b_g"].values == pytest.approx(B_G, abs=1e-9)
    assert found["speed_km_h"].values == pytest.approx(np.full(10, 16.0))
    assert np.isnan(found["oil_C"].values[1::2]).all()
    assert found["oil_C"].values[::2] == pytest.approx(90.0 + 0.1 * np.arange(0, 200, 40))
    assert found["q_mm"].clock is found["a_g"].clock
    start = found["q_mm"].clock.time_s[0]
    assert found["q_mm"].clock.time_s - start == pytest.approx(TIME_S, abs=2e-6)
    assert found["b_g"].clock.time_s - start == pytest.approx(TIME_S + 0.002, abs=2e-6)


@pytest.mark.parametrize(("written", "name"), WRITTEN)
def test_a_log_of_a_campaign(written: Callable[[], bytes], name: str):
    sensors = [
        Sensor("deflection", "suspension_deflection", "mm", axle=0, source="q_mm"),
        Sensor("b_g", "body_acceleration", "g", body=0, x_m=0.0),
    ]
    log = read_log(InputFile(Path(name), written()), name, sensors, 0.005, LogWriting(database=DATABASE))
    deflection, body = log.channels
    assert deflection.value == pytest.approx(1e-3 * Q_MM, abs=1e-12)
    assert body.time_s == pytest.approx(TIME_S + 0.002, abs=2e-6)
    assert log.sample_interval_s == 0.005


@pytest.mark.parametrize(
    ("database", "sentence"),
    [
        (None, "name its DBC file by can_database"),
        (DATABASE.split("BO_ 2566844926")[0].replace("256", "300").replace("257", "301").replace("258", "302"),
         "has no frame of a message in its CAN database"),
        ("BO_ what is this", "has a CAN database that cannot be read"),
    ],
)  # fmt: skip
def test_without_its_database_a_log_is_a_sentence(database: str | None, sentence: str):
    with pytest.raises(DataRejectedError, match=sentence):
        read_channels(InputFile(Path("log.blf"), blf()), "log.blf", LogRequest(("q_mm",), database=database))


@pytest.mark.parametrize(("written", "name"), WRITTEN)
def test_damaged_logs_end_in_a_result_or_a_sentence(written: Callable[[], bytes], name: str):
    data, rng = written(), np.random.default_rng(7)
    cut = [data[: len(data) // 3], data[:150]]
    for _ in range(6):
        flipped = bytearray(data)
        for place in rng.integers(0, len(data), 20):
            flipped[place] ^= 1 << int(rng.integers(8))
        cut.append(bytes(flipped))
    for one in cut:
        said = answer(InputFile(Path(name), one), name)
        assert said == "" or (said.startswith(name) and said.endswith("."))


def answer(file: InputFile, name: str) -> str:
    """The sentence that refuses a file, empty where it is read."""
    try:
        read_channels(file, name, LogRequest(("q_mm",), format="can", database=DATABASE))
    except DataRejectedError as error:
        return str(error)
    return ""
