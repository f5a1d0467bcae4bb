"""Clocks of text tables: several columns of time, stamps with too few digits, and numbers that are a clock."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from log_files import xlsx

from sysid.campaign import Sensor, read_log
from sysid.campaign.inputs.logs import LogWriting
from sysid.errors import DataRejectedError
from sysid.logs.input_file import InputFile

Q = Sensor("q", "suspension_deflection", "mm", axle=0)
A = Sensor("a", "axle_acceleration", "m/s^2", axle=0)


def read(text: str, sensors=(Q, A), step: float = 0.005, **writing):
    return read_log(InputFile(Path("log.csv"), text.encode()), "log.csv", sensors, step, LogWriting(**writing))


def side_by_side(header: str, fast: int = 400, slow: int = 200, order: str = "fast first", zero: float = 0.0) -> str:
    """Acceleration 1, 2, 3 ... every 2.5 ms beside a deflection 1, 2, 3 ... every 5 ms, `zero` later."""
    lines = [header]
    for i in range(fast):
        one = f"{0.0025 * i:.4f};{i + 1}"
        two = f"{0.005 * i + zero:.3f};{i + 1}" if i < slow else ";"
        lines.append(f"{one};{two}" if order == "fast first" else f"{two};{one}")
    return "\n".join(lines) + "\n"


def check_two_clocks(log, zero: float = 0.0) -> None:
    by_name = {c.sensor.column: c for c in log.channels}
    np.testing.assert_allclose(by_name["a"].time_s, 0.0025 * np.arange(400), atol=1e-9)
    np.testing.assert_allclose(by_name["a"].value, np.arange(1.0, 401.0))
    np.testing.assert_allclose(by_name["q"].time_s, zero + 0.005 * np.arange(200), atol=1e-9)
    np.testing.assert_allclose(by_name["q"].value, 1e-3 * np.arange(1.0, 201.0))


# ---------------------------------------------------------------------- several columns of time


@pytest.mark.parametrize(
    "names",
    ["time_s;a;time2_s;q", "Time 1 [s];a;Time 2 [s];q", "Zeit;a;Zeit;q", "time_s;a;time_s.1;q", "t [s];a;t2 [s];q",
     "Zeit  1 - Standardrate;a;Zeit  2 - langsam;q", "X_Value;a;X_Value;q"],
)  # fmt: skip
def test_a_channel_belongs_to_the_time_on_its_left(names: str) -> None:
    check_two_clocks(read(side_by_side(names)))
    a, b, c, d = names.split(";")
    check_two_clocks(read(side_by_side(f"{c};{d};{a};{b}", order="slow first")))


def test_two_clocks_of_one_rate_keep_their_distance() -> None:
    log = read(side_by_side("time_s;a;time2_s;q", zero=0.2))
    check_two_clocks(log, 0.2)
    rows = "".join(f"{0.005 * i:.3f};{i};{0.005 * i + 0.2:.3f};{i}\n" for i in range(100))
    q, a = read("time_s;a;time2_s;q\n" + rows).channels
    assert q.time_s[0] - a.time_s[0] == pytest.approx(0.2)


@pytest.mark.parametrize("name", ["time_s", "time2_s"])
def test_a_declared_time_cannot_be_that_of_a_channel_which_it_does_not_stamp(name: str) -> None:
    """Only the time on its left has a stamp beside every reading of the acceleration."""
    text = side_by_side("time_s;a;time2_s;q")
    if name == "time2_s":
        check_two_clocks(read(text, time=name))
    else:
        with pytest.raises(DataRejectedError, match=r"for 'q', 'time_s' \(column 1\) and 'time2_s' \(column 3\)"):
            read(text, time=name)


@pytest.mark.parametrize("names", ["q;time_s;a;time2_s", "time_s;time2_s;q;a"])
def test_columns_of_time_that_cannot_be_told_apart_are_named(names: str) -> None:
    """To the right of their channels, or side by side before all of them."""
    at = names.split(";")
    values = {"time_s": 0.005, "time2_s": 0.0025, "q": 1.0, "a": 1.0}
    rows = "".join(";".join(f"{values[n] * i:.4f}" for n in at) + "\n" for i in range(100))
    with pytest.raises(DataRejectedError, match=r"several columns of time for 'q', 'time_s' .* and 'time2_s'"):
        read(f"{names}\n{rows}")


def test_the_same_time_in_two_notations_is_one_clock() -> None:
    """Relative and absolute, in coarse digits, or a date that stands still: negative controls of the rule above."""
    rows = [(f"{0.005 * i:.3f}", f"10:05:{i * 0.005:06.3f}", i) for i in range(200)]
    for header in ("time_s;q;Uhrzeit;a", "time_s;Uhrzeit;q;a"):
        between = header.index("Uhrzeit") > header.index("q")
        lines = [f"{t};{i};{c};{i}" if between else f"{t};{c};{i};{i}" for t, c, i in rows]
        q, a = read("\n".join([header, *lines])).channels
        np.testing.assert_allclose(q.time_s, 0.005 * np.arange(200), atol=1e-9)
        np.testing.assert_array_equal(a.time_s, q.time_s)
    lines = [f"{t};{i};2024-05-06 10:05:00;{i}" for t, _, i in rows]
    np.testing.assert_allclose(read("\n".join(["time_s;q;timestamp;a", *lines])).channels[1].time_s[-1], 0.995)


def test_a_time_of_another_name_is_noticed_by_its_end() -> None:
    with pytest.raises(DataRejectedError, match=r"'q' ends in row 201, before the time 'time_s' does, .*'Takt', which"):
        read(side_by_side("time_s;a;Takt;q"))
    # A reading that is lost, with a counter beside it that runs on.
    rows = "".join(f"{0.005 * i:.3f};{i};{i};{i if i < 200 else ''}\n" for i in range(400))
    assert np.isnan(read("time_s;a;Takt;q\n" + rows).channels[0].value).sum() == 200


def test_a_slow_clock_that_is_held_is_the_time_of_nobody() -> None:
    """GPS time of day, HHMMSS, ten times a second, repeated between: the rows are those of the finer column."""

    def gps(i: int) -> str:
        t = 36_359.2 + 0.005 * i
        return "{:02d}{:02d}{:04.1f}".format(*in_parts(np.floor(t * 10.0 + 1e-6) / 10.0 + 1e-9))

    rows = "".join(f"{0.005 * i:.3f};{i};{gps(i)};{i}\n" for i in range(400))
    for channel in read("time_s;q;GPS time;a\n" + rows).channels:
        np.testing.assert_allclose(channel.time_s, 0.005 * np.arange(400), atol=1e-9)


def test_clocks_that_never_meet_are_named() -> None:
    text = side_by_side("time_s;a;time2_s;q", zero=500.0)
    with pytest.raises(DataRejectedError, match=r"'time_s' ends at 0.9975 s, that in 'time2_s' begins at 500 s"):
        read(text)


def test_rows_without_a_stamp_at_the_end_are_blank_only_if_they_hold_nothing() -> None:
    rows = "".join(f"{0.005 * i:.3f};{i};{i}\n" for i in range(100))
    log = read("time_s;q;a\n" + rows + ";;\n" * 80)
    assert log.channels[0].value.size == 100
    with pytest.raises(DataRejectedError, match=r"'q' has 80 readings from row 102 on.*'time_s' has ended"):
        read("time_s;q;a\n" + rows + ";1;\n" * 80)


def columns_side_by_side(second: str = "time2_s") -> dict[str, np.ndarray]:
    """The table of `side_by_side` as columns."""
    slow, count = np.full((2, 400), np.nan), np.arange(400)
    slow[0, :200], slow[1, :200] = 0.005 * count[:200], 1.0 + count[:200]
    return {"time_s": 0.0025 * count, "a": 1.0 + count, second: slow[0], "q": slow[1]}


def in_sheet(second: str = "time2_s") -> bytes:
    columns = columns_side_by_side(second)
    rows = [["" if np.isnan(v) else float(v) for v in row] for row in zip(*columns.values(), strict=True)]
    return xlsx([list(columns), ["s", "m/s^2", "s", "mm"], *rows])


def in_arrow(write, second: str = "time2_s") -> bytes:
    import pyarrow as pa

    stream = io.BytesIO()
    write(pa.table(columns_side_by_side(second)), stream)
    return stream.getvalue()


def in_tdms() -> bytes:
    """One group, channels of unequal length, as catman exports them."""
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        columns = columns_side_by_side()
        writer.write_segment([ChannelObject("log", n, v[np.isfinite(v)]) for n, v in columns.items()])
    return stream.getvalue()


def parquet(*what) -> None:
    from pyarrow.parquet import write_table

    write_table(*what)


def feather(*what) -> None:
    from pyarrow.feather import write_feather

    write_feather(*what, compression="uncompressed")


FORMATS = {
    "log.xlsx": in_sheet,
    "log.parquet": lambda: in_arrow(parquet),
    "log.feather": lambda: in_arrow(feather),
    "log.tdms": in_tdms,
}


@pytest.mark.parametrize(("name", "written"), FORMATS.items(), ids=FORMATS)
def test_every_format_with_columns_in_order_reads_them_alike(name: str, written) -> None:
    data = InputFile(Path(name), written())
    check_two_clocks(read_log(data, name, (Q, A), 0.005))
    if name != "log.tdms":  # where only one time has the length of the channel
        with pytest.raises(DataRejectedError, match=r"several columns of time for .*'time_s' \(.*'time2_s' \("):
            read_log(data, name, (Q, A), 0.005, LogWriting(time="time_s"))


@pytest.mark.parametrize(("name", "write"), [("log.xlsx", None), ("log.parquet", parquet), ("log.feather", feather)])
def test_a_time_of_another_name_is_noticed_in_every_format(name: str, write) -> None:
    data = in_sheet("Takt") if write is None else in_arrow(write, "Takt")
    with pytest.raises(DataRejectedError, match=r"no more readings of '.*q' .*'time_s' ends, and none of '.*Takt'"):
        read_log(InputFile(Path(name), data), name, (Q, A), 0.005)


# ---------------------------------------------------------------------- one time, channels of several rates


def test_slow_channels_are_said_once_for_all() -> None:
    """Of a binary table too, where cells between the samples of a slow channel are no lost readings."""
    import pyarrow as pa

    count = np.arange(400)
    between = np.where(count % 4 == 0, 1.0 * count, np.nan)
    names = ["q", "r", "s"]
    sensors = [A, *(Sensor(n, "suspension_deflection", "mm", axle=i) for i, n in enumerate(names))]
    rows = "".join(f"{0.005 * i:.3f};{i};{';'.join([str(i) if i % 4 == 0 else ''] * 3)}\n" for i in count)
    text = InputFile(Path("log.csv"), ("time_s;a;q;r;s\n" + rows).encode())
    stream = io.BytesIO()
    parquet(pa.table({"time_s": 0.005 * count, "a": 1.0 * count, **dict.fromkeys(names, between)}), stream)
    for file in (text, InputFile(Path("log.parquet"), stream.getvalue())):
        said = [m for m in read_log(file, "log", sensors, 0.005).messages if "different rates" not in m]
        assert said == [
            "log: 'q', 'r' and 's' have a reading in one of 4 rows, evenly spread; they are taken as sampled in "
            "these rows only."
        ]


@pytest.mark.parametrize("every", [2, 10])
def test_a_slow_channel_stands_in_some_rows_of_a_table(every: int) -> None:
    rows = "".join(f"{0.0025 * i:.4f};{i};{i if i % every == 1 else ''}\n" for i in range(2000))
    q, a = read("time_s;a;q\n" + rows, step=0.0025).channels
    np.testing.assert_allclose(q.time_s, 0.0025 * np.arange(1, 2000, every), atol=1e-9)
    np.testing.assert_allclose(q.value, 1e-3 * np.arange(1.0, 2000.0, every))
    assert a.value.size == 2000


def test_channels_merged_by_their_stamps() -> None:
    """Two channels of 200 and 60 Hz, each row with the stamp of one of them."""
    stamps = sorted(
        [(0.005 * i, f"{i}", "") for i in range(1000)] + [(0.0011 + i / 60, "", f"{i}") for i in range(290)]
    )
    q, a = read("time_s;a;q\n" + "".join(f"{t:.6f};{x};{y}\n" for t, x, y in stamps)).channels
    np.testing.assert_allclose(q.time_s, 0.0011 + np.arange(290) / 60, atol=2e-6)
    assert np.isfinite(q.value).all()
    seen = np.isfinite(a.value)
    np.testing.assert_allclose(a.time_s[seen], 0.005 * np.arange(1000), atol=1e-6)


def test_a_reading_that_is_lost_stays_missing() -> None:
    """Negative control: holes and a loose contact are no slower rate."""
    lost = np.random.default_rng(3).random(1000) < 0.3
    lost[400:700] = True
    rows = "".join(f"{0.005 * i:.3f};{i};{'' if gone else i}\n" for i, gone in enumerate(lost))
    q, _ = read("time_s;a;q\n" + rows).channels
    np.testing.assert_array_equal(np.isnan(q.value), lost)


# ---------------------------------------------------------------------- too few digits


def coarse(rate_hz: float, digits: int, count: int = 2000, lost: slice = slice(0), start: float = 0.0) -> str:
    rows = np.delete(np.arange(count), lost)
    return "time_s;q;a\n" + "".join(f"{start + i / rate_hz:.{digits}f};{i};{-i}\n" for i in rows)


@pytest.mark.parametrize(("rate_hz", "digits"), [(5000.0, 3), (2500.0, 3), (200.0, 2), (1613.0, 3), (48.0, 1)])
@pytest.mark.parametrize("start", [0.0, 36_000.3])
def test_the_rate_comes_from_the_count_where_rows_share_a_stamp(rate_hz: float, digits: int, start: float) -> None:
    log = read(coarse(rate_hz, digits, start=start), step=1.0 / rate_hz)
    # Half a digit of phase is not known.
    np.testing.assert_allclose(log.channels[0].time_s, np.arange(2000) / rate_hz, atol=0.02 / rate_hz)
    assert log.sample_interval_s == pytest.approx(1.0 / rate_hz, rel=1e-9)
    assert any("too few digits" in m and f"{rate_hz:.5g} Hz" in m for m in log.messages)


def test_a_rate_that_the_count_contradicts_is_asked_for() -> None:
    with pytest.raises(DataRejectedError, match=r"the rows are 0.0002 s apart, acquisition.* says 0.001 s; correct it"):
        read(coarse(5000.0, 3), step=0.001)


def test_a_pause_longer_than_the_digits_keeps_its_place() -> None:
    log = read(coarse(5000.0, 3, lost=slice(700, 900)), step=0.0002)
    time = log.channels[0].time_s
    np.testing.assert_allclose(np.diff(time)[[698, 700]], 0.0002, rtol=1e-3)
    # 200 rows are 40 ms; the stamps tell to 1 ms.
    assert time[700] - time[699] == pytest.approx(0.0402, abs=0.0005)


def test_rows_that_come_and_go_within_a_digit_are_refused() -> None:
    """A third of the rows lost here and there, which no stamp shows: the declared rate does not explain them."""
    kept = np.flatnonzero(np.random.default_rng(1).random(3000) > 1.0 / 3.0)
    text = "time_s;q;a\n" + "".join(f"{i / 5000.0:.3f};1;1\n" for i in kept)
    with pytest.raises(DataRejectedError, match=r"repeat the one before, .*do not explain them; correct it, or export"):
        read(text, step=0.0002)


def test_rounded_steps_do_not_shift_the_rate() -> None:
    """300 Hz with stamps of 1 ms: steps of 3 and 4 ms, of which 3 is the median."""
    log = read(coarse(300.0, 3), step=1.0 / 300.0)
    assert log.sample_interval_s == pytest.approx(1.0 / 300.0, rel=1e-9)
    np.testing.assert_allclose(log.channels[0].time_s, np.arange(2000) / 300.0, atol=0.0005)
    assert log.messages == ()


def test_jitter_of_the_clock_is_no_rounding() -> None:
    """Negative control: stamps that really waver stay as they are."""
    stamps = 0.005 * np.arange(500) + np.random.default_rng(2).uniform(-0.001, 0.001, 500)
    log = read("time_s;q;a\n" + "".join(f"{t:.6f};1;1\n" for t in stamps))
    np.testing.assert_allclose(log.channels[0].time_s, np.round(stamps, 6) - round(stamps[0], 6), atol=1e-9)


def test_a_late_record_in_32_bit_floats() -> None:
    """At 2000 s such a number has steps of 0.12 ms, under 0.2 ms of the rate."""
    from scipy.io import savemat

    rows = np.arange(6000)
    stream = io.BytesIO()
    savemat(stream, {"time_s": (2000.0 + rows / 5000.0).astype(np.float32), "q": rows * 1.0, "a": rows * 1.0})
    log = read_log(InputFile(Path("log.mat"), stream.getvalue()), "log.mat", (Q, A), 0.0002)
    np.testing.assert_allclose(log.channels[0].time_s, rows / 5000.0, atol=1e-5)


# ---------------------------------------------------------------------- clocks in digits and words


def clock(form, seconds: np.ndarray) -> str:
    return "time;q;a\n" + "".join(f"{form(t)};{i};{i}\n" for i, t in enumerate(seconds))


def in_parts(t: float) -> tuple[int, int, float]:
    return int(t // 3600) % 24, int(t // 60) % 60, t % 60


FORMS = {
    "HHMMSS.sss": lambda t: "{:02d}{:02d}{:06.3f}".format(*in_parts(t)),
    "colons": lambda t: "{:02d}:{:02d}:{:06.3f}".format(*in_parts(t)),
    "colon before the milliseconds": lambda t: "{:02d}:{:02d}:{:06.3f}".format(*in_parts(t)).replace(".", ":"),
    "minutes and seconds": lambda t: "{1:02d}:{2:06.3f}".format(*in_parts(t)),
    "zone of two digits": lambda t: "2024-05-06T{:02d}:{:02d}:{:06.3f}+02".format(*in_parts(t)),
    "zone by name": lambda t: "2024-05-06 {:02d}:{:02d}:{:06.3f} CEST".format(*in_parts(t)),
    "compact": lambda t: "20240506T{:02d}{:02d}{:06.3f}Z".format(*in_parts(t)),
    "month by name": lambda t: "Mo, 6. Mai 2024 {:02d}:{:02d}:{:06.3f}".format(*in_parts(t)),
    "half of the day": lambda t: "05/06/2024 {:02d}:{:02d}:{:06.3f} PM".format(*in_parts(t)),
    "difference of days": lambda t: "0 days {:02d}:{:02d}:{:06.3f}".format(*in_parts(t)),
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("start", [36_359.2, 39_599.0])  # 10:05:59.2, and 10:59:59, before the full hour
def test_a_clock_in_digits_or_words(form, start: float) -> None:
    time = 0.005 * np.arange(400)
    log = read(clock(form, np.round(start + time, 3)))
    for channel in log.channels:
        np.testing.assert_allclose(channel.time_s, time, atol=1e-6)


def test_seconds_that_pause_are_no_clock() -> None:
    """Negative control of HHMMSS: the count goes on at 200.1 s, and stands where a clock has no minute."""
    stamps = np.concatenate([np.arange(155.0, 159.9, 0.005), np.arange(200.1, 204.0, 0.005)])
    log = read("time;q;a\n" + "".join(f"{t:.3f};1;1\n" for t in stamps))
    assert log.duration_s == pytest.approx(stamps[-1] - 155.0, abs=1e-6)
    stamps = np.arange(50.0, 70.0, 0.005)
    log = read("time;q;a\n" + "".join(f"{t:.3f};1;1\n" for t in stamps))
    assert log.duration_s == pytest.approx(19.995)


@pytest.mark.parametrize(
    ("before", "after"),
    [("31/12/2024", "01/01/2025"), ("12/31/2024", "01/01/2025"), ("05/06/24", "06/06/24"), ("05/06/24", "05/07/24"),
     ("2024-12-31", "2025-01-01"), ("31.12.24", "01.01.25"), ("31-Dec-2024", "01-Jan-2025"), ("", "")],
)  # fmt: skip
@pytest.mark.parametrize("half", [False, True])
def test_midnight_in_every_order_of_the_fields_of_a_date(before: str, after: str, half: bool) -> None:
    def stamp(i: int) -> str:
        t = 86_399.0 + 0.005 * i
        text = "{:02d}:{:02d}:{:06.3f}".format(*in_parts(round(t % 86_400.0, 3)))
        if half:
            text = ("12" if t >= 86_400.0 else "11") + text[2:] + (" AM" if t >= 86_400.0 else " PM")
        return f"{before if t < 86_400.0 else after} {text}".strip()

    log = read("time;q;a\n" + "".join(f"{stamp(i)};1;1\n" for i in range(400)))
    np.testing.assert_allclose(log.channels[0].time_s, 0.005 * np.arange(400), atol=1e-6)


@pytest.mark.parametrize("part", [1, 10**3, 10**6, 10**9])
def test_seconds_since_1970_and_their_parts(part: int) -> None:
    start = 1_714_989_958
    stamps = [f"{start + 0.005 * i:.3f}" if part == 1 else start * part + i * part // 200 for i in range(300)]
    log = read("time;q;a\n" + "".join(f"{stamp};1;1\n" for stamp in stamps))
    np.testing.assert_allclose(log.channels[0].time_s, 0.005 * np.arange(300), atol=1e-6)
    assert log.start_time_s == pytest.approx(start)


def test_differences_to_the_row_before_are_added_up() -> None:
    for steps in (np.full(300, 0.005), 0.005 + 1e-4 * np.sin(np.arange(300.0))):
        log = read("time;q;a\n" + "".join(f"{s:.6f};1;1\n" for s in steps))
        np.testing.assert_allclose(log.channels[0].time_s[1:], np.cumsum(steps[1:]), atol=1e-4)
        assert any("since the row before" in m for m in log.messages)
    # A time that stands still is none, nor one with a row in the wrong place.
    with pytest.raises(DataRejectedError, match="repeat the one before"):
        read("time;q;a\n" + "36000.0;1;1\n" * 300)
    wrong = np.arange(0.5, 1.0, 0.005)
    wrong[50] = wrong[40]
    with pytest.raises(DataRejectedError, match="runs backward"):
        read("time;q;a\n" + "".join(f"{t:.3f};1;1\n" for t in wrong))


def test_stamps_before_a_trigger_are_negative() -> None:
    for minus in ("-", "\u2212", "\u2013"):
        text = clock(lambda t: f"{t:.3f}".replace("-", minus), 0.005 * np.arange(-100, 100))  # noqa: B023
        log = read(text)
        assert log.start_time_s == pytest.approx(-0.5)
        np.testing.assert_allclose(log.channels[0].time_s, 0.005 * np.arange(200), atol=1e-9)


@pytest.mark.parametrize("cell", ["10:05:58:12", "2024-05-06", "2024-05-06 10:05", "10:05", "10:61:00.0"])
def test_a_time_that_is_none_is_named_as_such(cell: str) -> None:
    with pytest.raises(
        DataRejectedError, match=r"row 2, column 'time' has '.*', expected a number; it is a (time|date)"
    ):
        read("time;q;a\n" + f"{cell};1;1\n" * 20)


def test_clocks_of_text_in_a_sheet() -> None:
    rows = [[f"06.05.2024 10:05:{58 + 0.005 * i:06.3f}", float(i), 0.0] for i in range(100)]
    data = InputFile(
        Path("log.xlsx"), xlsx([["Prüfstand 7"], ["Zeit", "q", "a"], ["TS", "mm", "g"], ["", "Smp", "Smp"], *rows])
    )
    log = read_log(data, "log.xlsx", (Q, Sensor("a", "axle_acceleration", "g", axle=0)), 0.005)
    np.testing.assert_allclose(log.channels[0].time_s, 0.005 * np.arange(100), atol=1e-6)
    assert log.start_time_s == pytest.approx(36_358.0)


def with_lost_row(step_s: float, resolution_s: float, lost: int | None = None, rows: int = 400) -> str:
    """Rows every `step_s` with stamps that are cut to a resolution, without one of them."""
    at = [i for i in range(rows) if i != lost]
    return "time_s;q;a\n" + "".join(
        f"{np.floor(i * step_s / resolution_s + 1e-9) * resolution_s:.3f};{i};{i}\n" for i in at
    )


def test_a_row_lost_between_repeated_stamps_is_no_other_rate() -> None:
    """The rate by count is 0.37 % low, k would be 0.7 %; the declared interval explains these stamps as well."""
    log = read(with_lost_row(0.005, 0.02, lost=201))
    np.testing.assert_allclose(np.diff(log.channels[0].time_s), 0.005, rtol=1e-9)
    # No row is lost: the rate of a logger 0.3 % slow stays, if it moves the stamps by more than their digits.
    for step in (0.005, 0.005 * 1.003):
        found = np.diff(read(with_lost_row(step, 0.02, rows=4000)).channels[0].time_s)
        np.testing.assert_allclose(found, step, rtol=2e-4)
