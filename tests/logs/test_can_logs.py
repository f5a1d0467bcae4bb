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


# ---------------------------------------------------------------------- buses, directions, stamps

HEAD = "date Mon May 6 10:05:58.000 am 2024\nbase hex  timestamps absolute\ninternal events logged\n"


def line(time_s: float, k: int, bus: int = 1, direction: str = "Rx", identifier: str = "100") -> str:
    """A line of an ASC file with one frame of AXLE_1."""
    data = struct.pack("<hh", round(100 * Q_MM[k]), round(1000 * A_G[k])).hex(" ").upper()
    return f"   {time_s:.6f} {bus}  {identifier}             {direction}   d 4 {data}\n"


def read_asc(text: str, *wanted: str):
    data = InputFile(Path("log.asc"), text.encode())
    return read_channels(data, "log.asc", LogRequest(wanted, format="can", database=DATABASE))


def lines(**more) -> list[str]:
    return [line(t, k, **more) for k, t in enumerate(TIME_S)]


def test_one_identifier_on_two_buses_is_two_signals() -> None:
    other = [line(t + 0.0007, (k + 7) % ROWS, 2) for k, t in enumerate(TIME_S)]
    text = HEAD + "".join(a + b for a, b in zip(lines(), other, strict=True))
    with pytest.raises(DataRejectedError, match="name the column 'AXLE_1 CAN 1/q_mm' or 'AXLE_1 CAN 2/q_mm'"):
        read_asc(text, "q_mm")
    first, second = read_asc(text, "AXLE_1 CAN 1/q_mm", "AXLE_1 CAN 2/q_mm").channels
    assert first.values == pytest.approx(Q_MM, abs=1e-9)
    assert second.values == pytest.approx(np.roll(Q_MM, -7), abs=1e-9)
    assert second.clock.time_s == pytest.approx(TIME_S + 0.0007, abs=1e-9)


def test_buses_of_a_blf_file_are_told_apart() -> None:
    stream = io.BytesIO()
    stream.close = lambda: None  # type: ignore[method-assign]
    with can.BLFWriter(stream) as writer:
        for k, time in enumerate(TIME_S):
            for bus, value in ((0, Q_MM[k]), (1, -Q_MM[k])):
                data = struct.pack("<hh", round(100 * value), 0)
                writer(can.Message(timestamp=START_S + time, arbitration_id=256, data=data, is_extended_id=False,
                                   channel=bus))  # fmt: skip
    file = InputFile(Path("log.blf"), stream.getvalue())
    (second,) = read_channels(file, "log.blf", LogRequest(("AXLE_1 CAN 2/q_mm",), database=DATABASE)).channels
    assert second.values == pytest.approx(-Q_MM, abs=1e-9)


@pytest.mark.parametrize("lost", [(), (50,)], ids=["all", "one echo lost"])
def test_frames_that_were_sent_and_received_are_one(lost: tuple[int, ...]) -> None:
    sent = lines(direction="Tx")
    back = ["" if k in lost else line(t + 0.0003, k) for k, t in enumerate(TIME_S)]
    content = read_asc(HEAD + "".join(a + b for a, b in zip(sent, back, strict=True)), "q_mm")
    (channel,) = content.channels
    assert channel.values == pytest.approx(Q_MM, abs=1e-9)
    assert np.diff(channel.clock.time_s) == pytest.approx(0.005, abs=1e-6)
    assert content.messages == ()


def test_a_request_to_send_is_no_frame() -> None:
    text = HEAD + "".join(a + b for a, b in zip(lines(direction="TxRq"), lines(direction="Tx"), strict=True))
    assert read_asc(text, "q_mm").channels[0].values == pytest.approx(Q_MM, abs=1e-9)


def test_frames_sent_by_two_are_no_echoes() -> None:
    other = [line(t + 0.0003, (k + 7) % ROWS, direction="Tx") for k, t in enumerate(TIME_S)]
    text = HEAD + "".join(a + b for a, b in zip(lines(), other, strict=True))
    with pytest.raises(DataRejectedError, match="'AXLE_1 received/q_mm' or 'AXLE_1 sent/q_mm'"):
        read_asc(text, "q_mm")


def test_frames_before_the_trigger_are_kept() -> None:
    text = HEAD + "".join(line(t - 0.45, k) for k, t in enumerate(TIME_S))
    content = read_asc(text, "q_mm")
    assert content.channels[0].values == pytest.approx(Q_MM, abs=1e-9)
    assert content.channels[0].clock.time_s == pytest.approx(TIME_S - 0.45, abs=1e-9)
    assert content.messages == ()


def test_relative_stamps_are_added_up() -> None:
    """Also those of lines between the frames."""
    relative = HEAD.replace("absolute", "relative")
    steps = [line(0.0, 0), *("   0.002000 1  Statistic: D 0 R 0\n" + line(0.003, k) for k in range(1, ROWS))]
    content = read_asc(relative + "".join(steps), "q_mm")
    assert content.channels[0].clock.time_s == pytest.approx(TIME_S, abs=1e-9)
    assert content.messages == ()


def test_the_first_frame_behind_a_short_header_is_kept() -> None:
    content = read_asc(HEAD.replace("internal events logged\n", "") + "".join(lines()), "q_mm")
    assert content.channels[0].values == pytest.approx(Q_MM, abs=1e-9)


def test_lines_that_are_not_understood_are_counted() -> None:
    foreign = "   0.100000 18FEF121x J1939PG Rx d 8 00 00 00 00 00 00 00 00\n"
    text = HEAD + line(0.0, 0) + foreign + "   0.2 1 ErrorFrame\n" + foreign + line(0.3, 1) + "   0.4 log trigger\n"
    (errors, said) = sorted(read_asc(text, "q_mm").messages)
    assert "1 error frames and 0 remote frames hold no signals" in errors
    assert "2 lines with frames were not understood, the first is line 5" in said


@pytest.mark.parametrize(("base", "identifier"), [("hex", "100"), ("dec", "256")])
def test_numbers_of_both_bases(base: str, identifier: str) -> None:
    rows = []
    for k, time in enumerate(TIME_S):
        data = struct.pack("<hh", round(100 * Q_MM[k]), round(1000 * A_G[k]))
        shown = " ".join(f"{b:02X}" if base == "hex" else str(b) for b in data)
        rows.append(f"   {time:.6f} 1  {identifier}             Rx   d 4 {shown}\n")
    assert read_asc(HEAD.replace("hex", base) + "".join(rows), "q_mm").channels[0].values == pytest.approx(Q_MM)


def test_values_that_the_database_excludes_are_missing() -> None:
    """Out of the range, a value called SNA, and all bits set in a message of SAE J1939."""
    database = DATABASE.replace("[-32|32]", "[-0.4|0.4]") + 'VAL_ 256 q_mm 1234 "SNA" 100 "centre" ;\n'
    database += 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    database += 'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";\nBA_ "VFrameFormat" BO_ 2566844926 3;\n'
    database = database.replace("[0|250]", "[0|0]")
    q_mm = Q_MM.copy()
    q_mm[5], q_mm[6] = 12.34, 1.0
    rows = []
    for k, time in enumerate(TIME_S):
        data = struct.pack("<hh", round(100 * q_mm[k]), round(1000 * A_G[k])).hex(" ")
        speed = struct.pack("<BH5x", 255, 0xFFFF if k == 7 else 4096).hex(" ")
        rows.append(f"   {time:.6f} 1  100             Rx   d 4 {data}\n")
        rows.append(f"   {time:.6f} 1  18FEF121x       Rx   d 8 {speed}\n")
    file = InputFile(Path("log.asc"), (HEAD + "".join(rows)).encode())
    content = read_channels(file, "log.asc", LogRequest(("q_mm", "a_g", "speed_km_h"), database=database))
    q, a, speed = (c.values for c in content.channels)
    assert np.flatnonzero(np.isnan(q)).tolist() == [5]
    assert q[6] == pytest.approx(1.0)
    np.testing.assert_array_equal(np.isnan(a), np.abs(A_G) > 0.4)
    assert np.flatnonzero(np.isnan(speed)).tolist() == [7]
    assert speed[0] == pytest.approx(16.0)
    assert len(content.messages) == 3
    assert "1 of 200 samples of 'AXLE_1/q_mm' are outside the range of the database" in content.messages[0]


def answer(file: InputFile, name: str) -> str:
    """The sentence that refuses a file, empty where it is read."""
    try:
        read_channels(file, name, LogRequest(("q_mm",), format="can", database=DATABASE))
    except DataRejectedError as error:
        return str(error)
    return ""
