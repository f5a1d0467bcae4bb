"""A clock is its stamps, and the place in the file is part of a signal's identity."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import Sensor, read_log
from sysid.errors import DataRejectedError
from sysid.logs.channels import LogRequest
from sysid.logs.input_file import InputFile
from sysid.logs.registry import read_channels
from sysid.logs.selection import FileChannel, RefusedError, selected

STEP_S = 0.005
#: Two records of one length; the second begins later.
FIRST_S = STEP_S * np.arange(380)
LATER_S = 0.1 + STEP_S * np.arange(380)
Q = Sensor("q_mm", "suspension_deflection", "mm", axle=0)
A = Sensor("a_g", "axle_acceleration", "g", axle=0)


def pulse(time_s: np.ndarray) -> np.ndarray:
    """A pulse whose largest value stands at 0.5 s."""
    return np.exp(-(((time_s - 0.5) / 0.05) ** 2))


def read(name: str, data: bytes, sensors=(Q, A), step: float = STEP_S):
    return read_log(InputFile(Path(name), data), name, sensors, step)


def channels(name: str, data: bytes, *wanted: str, **request):
    return read_channels(InputFile(Path(name), data), name, LogRequest(wanted, **request)).channels


def mdf(*groups, version: str = "4.10") -> bytes:
    """MDF with groups (stamps, values by name, name of the group), as the writer of asammdf makes them."""
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    with MDF(version=version) as file:
        for time_s, values, label in groups:
            file.append([Signal(v, time_s, name=n, unit=n.rpartition("_")[2]) for n, v in values.items()])
            if version >= "4":
                file.groups[-1].channel_group.acq_name = label
        file.save(stream)
    return stream.getvalue()


# ---------------------------------------------------------------------- clocks


def test_two_groups_of_one_name_keep_their_stamps() -> None:
    data = mdf((FIRST_S, {"q_mm": pulse(FIRST_S)}, "10ms"), (LATER_S, {"a_g": pulse(LATER_S)}, "10ms"))
    log = read("log.mf4", data)
    for channel, first in zip(log.channels, (0.0, 0.1), strict=True):
        assert channel.time_s[0] == pytest.approx(first, abs=1e-12)
        assert channel.time_s[np.argmax(channel.value)] == pytest.approx(0.5, abs=1e-9)


def test_two_groups_of_one_name_keep_their_rates() -> None:
    fast = 0.5 * FIRST_S
    data = mdf((fast, {"a_g": pulse(fast)}, "10ms"), (FIRST_S, {"q_mm": pulse(FIRST_S)}, "10ms"))
    found = {c.name: c for c in channels("log.mf4", data, "a_g", "q_mm")}
    assert np.diff(found["q_mm"].clock.time_s) == pytest.approx(0.005, abs=1e-12)
    assert np.diff(found["a_g"].clock.time_s) == pytest.approx(0.0025, abs=1e-12)


def test_equal_stamps_of_two_groups_are_one_clock() -> None:
    data = mdf((FIRST_S, {"q_mm": pulse(FIRST_S)}, "A"), (FIRST_S, {"a_g": pulse(FIRST_S)}, "B"))
    q, a = channels("log.mf4", data, "q_mm", "a_g")
    assert q.clock is a.clock


def test_stamps_that_differ_in_the_middle_are_two_clocks() -> None:
    """Length and end points agree."""
    other = FIRST_S.copy()
    other[100:200] += 0.001
    data = mdf((FIRST_S, {"q_mm": pulse(FIRST_S)}, "A"), (other, {"a_g": pulse(other)}, "A"))
    q, a = channels("log.mf4", data, "q_mm", "a_g")
    np.testing.assert_array_equal(q.clock.time_s, FIRST_S)
    np.testing.assert_array_equal(a.clock.time_s, other)


def test_clocks_that_share_no_moment_are_refused() -> None:
    data = mdf((FIRST_S, {"q_mm": pulse(FIRST_S)}, "A"), (36_000.0 + FIRST_S, {"a_g": pulse(FIRST_S)}, "B"))
    with pytest.raises(DataRejectedError, match=r"'time of A' ends at 1.895 s, that in 'time of B' begins at 36000 s"):
        read("log.mf4", data)
    assert len(read("log.mf4", data, [Q]).channels) == 1


def column(name: str, values, group: str = "", unit: str | None = None, **more) -> FileChannel:
    return FileChannel(name, len(values), lambda: (np.asarray(values), unit), group, **more)


def stamps_of(found, wanted: str, time: str | None = None):
    return list(selected(found, {"wanted": [wanted], "time": time})[1][0])


TWO_TIMES = [
    column("time", [0.0, 1.0, 2.0], "S"), column("a", [1, 2, 3], "S"),
    column("t", [5.0, 7.0, 9.0], "S"), column("q", [1, 2, 3], "S"),
]  # fmt: skip


def test_of_several_columns_of_time_the_nearest_on_the_left_counts() -> None:
    assert stamps_of(TWO_TIMES, "a") == [0.0, 1.0, 2.0]
    assert stamps_of(TWO_TIMES, "q") == [5.0, 7.0, 9.0]
    for name in ("time", "S/time"):
        assert stamps_of(TWO_TIMES, "a", name) == [0.0, 1.0, 2.0]
        # The declared one is not the nearest: one of both is wrong.
        with pytest.raises(
            RefusedError, match=r"for 'S/q', 'time' \(column 1\) and 't' \(column 3\), and 'time' names"
        ):
            stamps_of(TWO_TIMES, "q", name)


def test_of_several_columns_of_time_in_no_order_none_is_taken() -> None:
    from dataclasses import replace

    with pytest.raises(RefusedError, match="several columns of time for 'S/q', 'S/time' and 'S/t', which do not agree"):
        stamps_of([replace(c, in_order=False) for c in TWO_TIMES], "q")


def test_two_columns_of_time_that_agree_but_for_their_zero_are_one() -> None:
    found = [column("timestamp", [50.0, 51.0, 52.0]), column("time_s", [0.0, 1.0, 2.0]), column("q", [1, 2, 3])]
    assert stamps_of(found, "q") == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("later", [0.5, 2.0])
def test_columns_of_time_with_equal_steps_whose_spans_overlap_are_two_clocks(later: float) -> None:
    """Two devices on one time base, of which one began later: not one clock in two notations."""
    second = [later, 1.0 + later, 2.0 + later]
    found = [column("time1", [0.0, 1.0, 2.0]), column("q", [1, 2, 3]), column("time2", second), column("a", [1, 2, 3])]
    assert stamps_of(found, "q") == [0.0, 1.0, 2.0]
    assert stamps_of(found, "a") == second
    without_order = [column(c.name, c.load()[0], in_order=False) for c in found]
    with pytest.raises(RefusedError, match="several columns of time for 'a', 'time1' and 'time2', which do not agree"):
        stamps_of(without_order, "a")


def test_a_time_of_another_part_counts_only_if_there_is_no_other() -> None:
    found = [column("time", [0.0, 1.0, 2.0], "A"), column("q", [1, 2, 3], "B")]
    assert stamps_of(found, "q") == [0.0, 1.0, 2.0]
    with pytest.raises(RefusedError, match="no time column for 'B/q'"):
        stamps_of([*found, column("time", [0.0, 1.0], "C")], "q")
    assert stamps_of([*found, column("t", [3.0, 4.0, 5.0])], "q") == [3.0, 4.0, 5.0]
    inside = [column("time", [6.0, 7.0, 8.0], "B"), column("q", [1, 2, 3], "B/front")]
    assert stamps_of([found[0], *inside], "q") == [6.0, 7.0, 8.0]


def test_stamps_of_its_own_count_for_more_than_a_wanted_column_elsewhere() -> None:
    def own() -> np.ndarray:
        return np.array([0.0, 1.0, 2.0])

    found = [column("q", [1, 2, 3], "A", time=own), column("clock", [5.0, 6.0, 7.0], "B", time=own)]
    assert stamps_of(found, "q", "clock") == [0.0, 1.0, 2.0]
    assert stamps_of([*found, column("clock", [5.0, 6.0, 7.0], "A")], "q", "clock") == [5.0, 6.0, 7.0]


def test_dates_of_two_parts_have_one_zero() -> None:
    first = np.datetime64("2024-05-01T10:00:00", "ns") + np.array([0, 5, 10], "m8[ms]")
    found = [
        column("time", first, "A"), column("q", [1, 2, 3], "A"),
        column("time", first + np.timedelta64(250, "ms"), "B"), column("a", [1, 2, 3], "B"),
    ]  # fmt: skip
    _, (q, a, *_) = selected(found, {"wanted": ["q", "a"], "time": None})
    assert q == pytest.approx([36000.0, 36000.005, 36000.01], abs=1e-9)
    assert a - q == pytest.approx(0.25, abs=1e-9)


def test_a_column_of_time_in_another_unit_is_converted_or_refused() -> None:
    for unit, factor in (("ms", 1e-3), ("[us]", 1e-6), ("min", 60.0), ("-", 1.0)):
        found = [column("time", [0.0, 5.0], unit=unit), column("q", [1, 2])]
        assert stamps_of(found, "q") == pytest.approx([0.0, 5.0 * factor], rel=1e-12)
    with pytest.raises(RefusedError, match=r"its axis is 'time' \[rev\], not time"):
        stamps_of([column("time", [0.0, 5.0], unit="rev"), column("q", [1, 2])], "q")


# ---------------------------------------------------------------------- names


def test_a_name_in_two_groups_of_one_name_wants_its_group() -> None:
    data = mdf((FIRST_S, {"q_mm": pulse(FIRST_S)}, "10ms"), (LATER_S, {"q_mm": 2.0 * pulse(LATER_S)}, "10ms"))
    with pytest.raises(DataRejectedError, match=r"2 channels with the name 'q_mm'; name .* '10ms #1/q_mm' or '10ms #2"):
        read("log.mf4", data, [Q])
    (second,) = channels("log.mf4", data, "10ms #2/q_mm")
    np.testing.assert_array_equal(second.values, 2.0 * pulse(LATER_S))
    np.testing.assert_array_equal(second.clock.time_s, LATER_S)
    everything = channels("log.mf4", data, everything=True)
    assert [c.name for c in everything] == ["10ms #1/q_mm", "10ms #2/q_mm"]


def test_a_group_that_another_has_the_name_of_is_still_found_by_it() -> None:
    data = mdf((FIRST_S, {"q_mm": pulse(FIRST_S)}, "10ms"), (LATER_S, {"a_g": pulse(LATER_S)}, "10ms"))
    (found,) = channels("log.mf4", data, "10ms/a_g")
    np.testing.assert_array_equal(found.clock.time_s, LATER_S)


def test_a_name_twice_in_one_group_can_be_asked_for() -> None:
    found = [column("time", [0.0, 1.0]), column("q", [1, 2]), column("q", [3, 4])]
    with pytest.raises(RefusedError, match="name the column 'q #1' or 'q #2'"):
        selected(found, {"wanted": ["q"], "time": None})
    _, (_, second) = selected(found, {"wanted": ["q #2"], "time": None})
    assert list(second) == [3.0, 4.0]


COMPOSED, DECOMPOSED = "Federweg_ä", "Federweg_a\u0308"


@pytest.mark.parametrize("written", [COMPOSED, DECOMPOSED], ids=["composed", "decomposed"])
@pytest.mark.parametrize("asked", [COMPOSED, DECOMPOSED], ids=["composed", "decomposed"])
@pytest.mark.parametrize("form", ["csv", "mf4"])
def test_names_are_compared_as_they_are_read(written: str, asked: str, form: str) -> None:
    rows = "".join(f"{t};{v}\n" for t, v in zip(FIRST_S, pulse(FIRST_S), strict=True))
    data = f"time_s;{written}\n{rows}".encode() if form == "csv" else mdf((FIRST_S, {written: pulse(FIRST_S)}, "A"))
    log = read(f"log.{form}", data, [Sensor(asked, "suspension_deflection", "mm", axle=0)])
    assert log.messages == ()
    assert log.channels[0].value == pytest.approx(1e-3 * pulse(FIRST_S))


# ---------------------------------------------------------------------- MDF


def test_samples_that_mdf_marks_as_invalid_are_missing() -> None:
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    q_invalid, a_invalid = (np.isin(np.arange(380), rows) for rows in (range(300, 360), range(10, 70)))
    with MDF(version="4.10") as file:
        file.append(
            [
                Signal(pulse(FIRST_S), FIRST_S, name="q_mm", unit="mm", invalidation_bits=q_invalid),
                Signal(pulse(FIRST_S), FIRST_S, name="a_g", unit="g", invalidation_bits=a_invalid),
            ]
        )
        file.save(stream)
    log = read("log.mf4", stream.getvalue())
    for channel, invalid in zip(log.channels, (q_invalid, a_invalid), strict=True):
        np.testing.assert_array_equal(channel.time_s, FIRST_S)
        np.testing.assert_array_equal(np.isnan(channel.value), invalid)
        assert channel.time_s[np.nanargmax(channel.value)] == pytest.approx(0.5)
    assert [m.partition("/")[2] for m in log.messages] == [
        f"{n}' are marked as invalid or hold no number; they are missing." for n in ("q_mm", "a_g")
    ]
    assert all("60 of 380 samples" in m for m in log.messages)


@pytest.mark.parametrize("text", [False, True], ids=["mdf", "text"])
def test_numbers_that_no_sensor_reads_are_missing(text: bool) -> None:
    values, stamps = pulse(FIRST_S), FIRST_S.copy()
    values[7], stamps[9] = -1e308, 1e305
    rows = "".join(f"{t},{q}\n" for t, q in zip(stamps.tolist(), values.tolist(), strict=True))
    content = ("time_s,q_mm\n" + rows).encode() if text else mdf((stamps, {"q_mm": values}, "A"))
    (found,) = channels("log.csv" if text else "log.mf4", content, "q_mm")
    assert np.flatnonzero(np.isnan(found.values)).tolist() == [7]
    assert np.flatnonzero(np.isnan(found.clock.time_s)).tolist() == [9]


@pytest.mark.parametrize(("kind", "axis"), [(2, "angle [deg]"), (3, "distance [m]"), (4, "index [index]")])
def test_a_master_that_is_not_time_is_refused(kind: int, axis: str) -> None:
    """The units are those that the writer gives such masters."""
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    with MDF(version="4.10") as file:
        file.append([Signal(pulse(FIRST_S), FIRST_S, name="q_mm", unit="mm", master_metadata=("x", kind))])
        file.save(stream)
    with pytest.raises(DataRejectedError) as error:
        read("log.mf4", stream.getvalue(), [Q])
    assert f"its axis is {axis}, not time" in str(error.value)


def changed_mdf(change) -> bytes:
    """MDF of one channel whose blocks are changed before they are written."""
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    with MDF(version="4.10") as file:
        file.append([Signal(pulse(FIRST_S), FIRST_S, name="q_mm", unit="mm")])
        change(*file.groups[0].channels)
        file.save(stream)
    return stream.getvalue()


def test_a_channel_that_mdf_marks_as_invalid_as_a_whole_is_missing() -> None:
    def change(master, channel) -> None:
        channel.flags |= 1

    (found,) = channels("log.mf4", changed_mdf(change), "q_mm")
    assert np.isnan(found.values).all()


def test_a_group_of_mdf_without_a_master_has_no_time() -> None:
    """The library counts its rows."""

    def change(master, channel) -> None:
        master.channel_type = master.sync_type = 0

    with pytest.raises(DataRejectedError, match="no channel of time in the group 'group 0'"):
        read("log.mf4", changed_mdf(change), [Q])


@pytest.mark.parametrize(
    ("name", "unit", "said"), [("time", "s", None), ("x", "deg", "x [deg]"), ("crank", "", "crank")]
)
def test_a_master_of_mdf_without_a_kind_says_it_by_name_and_unit(name: str, unit: str, said: str | None) -> None:
    def change(master, channel) -> None:
        master.name, master.unit, master.sync_type = name, unit, 0

    data = changed_mdf(change)
    if said is None:
        np.testing.assert_array_equal(channels("log.mf4", data, "q_mm")[0].clock.time_s, FIRST_S)
    else:
        with pytest.raises(DataRejectedError) as error:
            read("log.mf4", data, [Q])
        assert f"its axis is {said}, not time" in str(error.value)


def test_segments_of_lvm_with_one_name_keep_their_clocks() -> None:
    def segment(name: str, step: str, start: str) -> list[str]:
        rows = [f"\t{v:.3f}\t" for v in pulse(FIRST_S)]
        return [
            "", "Channels\t1\t", "Samples\t380\t", "Y_Unit_Label\tmm\t", "X_Dimension\tTime\t", f"X0\t{start}\t",
            f"Delta_X\t{step}\t", "***End_of_Header***\t\t", f"X_Value\t{name}\tComment", *rows,
        ]  # fmt: skip

    head = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tNo", "***End_of_Header***"]
    same = "\r\n".join([*head, *segment("q_mm", "0.005", "0"), *segment("q_mm", "0.0025", "0.1"), ""]).encode()
    with pytest.raises(DataRejectedError, match="'segment 1/q_mm' or 'segment 2/q_mm'"):
        read("log.lvm", same, [Q])
    (second,) = channels("log.lvm", same, "segment 2/q_mm")
    np.testing.assert_allclose(second.clock.time_s, 0.1 + 0.5 * FIRST_S, rtol=0.0, atol=1e-12)


def test_groups_of_hdf5_and_tdms_keep_their_clocks() -> None:
    """Equal names, lengths and ends of the time channels in both groups."""
    import h5py
    from nptdms import ChannelObject, TdmsWriter

    bent = FIRST_S.copy()
    bent[100:200] += 0.001
    hdf5, tdms = io.BytesIO(), io.BytesIO()
    with h5py.File(hdf5, "w") as file, TdmsWriter(tdms) as writer:
        for group, time, name in (("A", FIRST_S, "q_mm"), ("B", bent, "a_g")):
            file[f"{group}/time"], file[f"{group}/{name}"] = time, pulse(time)
            writer.write_segment([ChannelObject(group, "time", time), ChannelObject(group, name, pulse(time))])
    for name, stream in (("log.h5", hdf5), ("log.tdms", tdms)):
        q, a = channels(name, stream.getvalue(), "q_mm", "a_g")
        np.testing.assert_array_equal(q.clock.time_s, FIRST_S)
        np.testing.assert_array_equal(a.clock.time_s, bent)


# ---------------------------------------------------------------------- stamps that are right


@pytest.mark.parametrize("rows", [60, 190, 1000])
@pytest.mark.parametrize("step_s", [0.001, 0.005, 0.01])
def test_pauses_and_lost_rows_are_no_rounding(rows: int, step_s: float) -> None:
    """Stamps of an even logger stay as they are, however many rows it lost and wherever it paused."""
    rng = np.random.default_rng(7)
    even = step_s * np.arange(rows)
    paused = even + 0.25 * (np.arange(rows) >= rows // 2)
    lost = [np.delete(even, rng.choice(np.arange(1, rows - 1), count, replace=False)) for count in (1, 2, rows // 30)]
    for stamps in (paused, *lost):
        (found,) = channels("log.mf4", mdf((np.round(stamps, 6), {"q_mm": np.cos(stamps)}, "A")), "q_mm")
        np.testing.assert_allclose(found.clock.time_s, stamps, rtol=0.0, atol=1e-6)


def test_a_pause_in_stamps_with_few_digits_stays() -> None:
    """5 kHz with 1 ms digits, 100 rows and a pause of 0.25 s: five rows share each stamp."""
    true_s = 0.0002 * np.arange(100) + 0.25 * (np.arange(100) >= 50)
    (found,) = channels("log.mf4", mdf((np.floor(1e3 * true_s) / 1e3, {"q_mm": true_s}, "A")), "q_mm")
    assert np.abs(found.clock.time_s - true_s).max() < 0.001
