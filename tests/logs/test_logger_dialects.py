"""Text logs as loggers write them: names and units of time, rows of units, clocks, error marks, signs and scales."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import Sensor, read_log
from sysid.campaign.inputs.logs import LogWriting
from sysid.errors import DataRejectedError
from sysid.logs.input_file import InputFile
from sysid.logs.text_table import open_table

SENSORS = (Sensor("q", "suspension_deflection", "mm", axle=0),)
STEP_S = 0.01
STAMPS = [0.0, 0.01, 0.02, 0.03]
VALUES = [1.0, 2.0, -1.5, 0.25]


def read(text: str, sensors=SENSORS, name: str = "log.csv", step: float = STEP_S, **writing):
    data = InputFile(Path(name), text.encode())
    return read_log(data, name, sensors, step, LogWriting(**writing))


def table(header: str, stamps, values=VALUES, delimiter: str = ";") -> str:
    rows = [f"{t}{delimiter}{v}" for t, v in zip(stamps, values, strict=True)]
    return "\n".join([header, *rows, ""])


def check(log, first: float = 0.0) -> None:
    assert log.channels[0].time_s == pytest.approx(STAMPS, abs=1e-9)
    assert log.channels[0].value == pytest.approx([1e-3 * v for v in VALUES], rel=1e-12)
    assert log.start_time_s == pytest.approx(first, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "factor"),
    [("Zeit [s]", 1), ("Zeit", 1), ("Zeit (ms)", 1e3), ("zeit_ms", 1e3), ("Temps [us]", 1e6), ("X_Value", 1)],
)
def test_the_column_of_time_has_a_name_and_a_unit(name: str, factor: float) -> None:
    text = table(f"{name};q", [round(t * factor, 6) for t in STAMPS])
    check(read(text, time=name))
    check(read(text, time=f" {name.upper()} "))


def test_x_value_is_time() -> None:
    check(read(table("X_Value;q", STAMPS)))


def test_a_wanted_time_that_is_missing_is_named() -> None:
    with pytest.raises(DataRejectedError, match=r"no time column .* expected 'Zeit'"):
        read(table("time_s;q", STAMPS), time="Zeit")


def test_a_row_of_units_is_read() -> None:
    text = table("Zeit;q", [1e3 * t for t in STAMPS]).replace("q\n", "q\n[ms];[mm]\n")
    check(read(text, time="Zeit", units_row=True))
    with pytest.raises(DataRejectedError, match=r"the file says that 'q' is in 'cm', campaign.toml says 'mm'"):
        read(text.replace("[mm]", "[cm]"), time="Zeit", units_row=True)


@pytest.mark.parametrize("unit", ["mm", "Millimeter", "", "counts"])
def test_a_unit_that_fits_or_says_nothing_is_taken(unit: str) -> None:
    check(read(table("time_s;q", STAMPS).replace("q\n", f"q\ns;{unit}\n"), units_row=True))


@pytest.mark.parametrize(
    ("declared", "written"), [("m/s^2", "m/s²"), ("m/s^2", "m s-2"), ("g", "G"), ("mm/s2", "mm/s/s")]
)
def test_one_unit_has_many_spellings(declared: str, written: str) -> None:
    sensor = Sensor("q", "axle_acceleration", declared, axle=0)
    text = table("time_s;q", STAMPS).replace("q\n", f"q\ns;{written}\n")
    assert len(read(text, [sensor], units_row=True).channels) == 1
    other = "m/s^2" if declared == "g" else "g"
    with pytest.raises(DataRejectedError, match="the file says"):
        read(text.replace(written, other), [sensor], units_row=True)


def test_a_scaled_sensor_may_be_in_volts() -> None:
    text = table("time_s;q", STAMPS).replace("q\n", "q\ns;V\n")
    with pytest.raises(DataRejectedError, match=r"in 'V'.*give the sensor a scale"):
        read(text, units_row=True)
    sensor = Sensor("q", "suspension_deflection", "mm", axle=0, scale=25.0, sign=-1, full_scale=0.05)
    channel = read(text, [sensor], units_row=True).channels[0]
    assert channel.value == pytest.approx([-0.025, -0.05, 0.0375, -0.00625], rel=1e-12)
    assert channel.censored.tolist() == [0, -1, 0, 0]


CLOCKS = {
    "ISO": ("2024-05-01T10:00:00.{:03d}", 36000.0),
    "ISO with a space and a zone": ("2024-05-01 12:00:00.{:03d}+02:00", 36000.0),
    "ISO, decimal comma": ("2024-05-01 10:00:00,{:03d}", 36000.0),
    "date with dots": ("01.05.2024 10:00:00.{:03d}", 36000.0),
    "clock": ("10:00:00.{:03d}", 36000.0),
    "minutes and seconds": ("02:05.{:03d}", 125.0),
}


@pytest.mark.parametrize(("form", "first"), CLOCKS.values(), ids=CLOCKS)
def test_dates_and_clocks_become_seconds(form: str, first: float) -> None:
    check(read(table("time;q", [form.format(round(1e3 * t)) for t in STAMPS])), first)


@pytest.mark.parametrize("date", ["", "2024-12-31 "])
def test_a_clock_may_pass_midnight(date: str) -> None:
    after = "2025-01-01 " if date else ""
    stamps = [f"{date}23:59:59.98", f"{date}23:59:59.99", f"{after}00:00:00.00", f"{after}00:00:00.01"]
    check(read(table("time;q", stamps)), 86399.98)


def test_a_clock_that_breaks_off_names_its_row() -> None:
    stamps = ["10:00:00.000", "10:00:00.010", "later", "10:00:00.030"]
    with pytest.raises(DataRejectedError, match=r"row 4, column 'time' has 'later'"):
        read(table("time;q", stamps))


@pytest.mark.parametrize("mark", ["#N/A", "#NV", "#VALUE!", "#DIV/0!", "#BEZUG!"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le"])
def test_error_marks_of_spreadsheets_are_missing_values(mark: str, encoding: str) -> None:
    text = "time_s;q;r\n0.00;1;1\n" + f"0.01;{mark};2\n0.02;3;{mark}\n# a comment\n0.03;4;5\n"
    sensors = [*SENSORS, Sensor("r", "axle_acceleration", "g", axle=0)]
    log = read_log(InputFile(Path("log.csv"), text.encode(encoding)), "log.csv", sensors, STEP_S)
    assert np.isnan(log.channels[0].value).tolist() == [False, True, False, False]
    assert np.isnan(log.channels[1].value).tolist() == [False, False, True, False]


def test_a_date_with_dots_says_nothing_about_the_decimal_mark() -> None:
    stamps = [f"01.02.2024 10:00:00,{round(1e3 * t):03d}" for t in STAMPS]
    check(read(table("time;q", stamps, [str(v).replace(".", ",") for v in VALUES])), 36000.0)
    other = "\n".join(["time_s;version;q", *(f"{i};1.2.3;0,5" for i in range(9))])
    assert read(other, step=1.0).channels[0].value == pytest.approx([5e-4] * 9)


@pytest.mark.parametrize("quiet", [150, 200_000])
@pytest.mark.parametrize("time", ["{}", "01.02.2024 10:{:02d}:00.000"])
def test_the_decimal_mark_is_found_behind_whole_numbers(quiet: int, time: str) -> None:
    rows = [f"{time.format(i % 60)};0" for i in range(quiet)] + [f"{time.format(0)};0,5"]
    file = InputFile(Path("log.csv"), "\n".join(["time;q", *rows]).encode())
    assert open_table(file, "log.csv", ["q"], lambda name: name == "time").layout.decimal == ","


@pytest.mark.parametrize(
    ("cell", "row"), [("1.234", 3), ("1.234,5", 3), ("1.5", 3), ("12.345.678", 3), ("-1.000", 2), ("0.5", 2)]
)
def test_a_point_among_decimal_commas_is_refused(cell: str, row: int) -> None:
    values = ["999,5", "999,5", "999,25", "998,5"]
    values[row - 2] = cell
    text = table("time_s;q", ["0,00", "0,01", "0,02", "0,03"], values)
    hint = rf"row {row}, column 'q' has '{cell}', expected a number; use the decimal comma in every cell, and no points"
    with pytest.raises(DataRejectedError, match=hint):
        read(text)


@pytest.mark.parametrize("name", ["Zeit [h]", "Zeit [ms]", "time_ms"])
def test_clock_times_are_no_counts_of_the_unit_in_the_name(name: str) -> None:
    stamps = [f"10:00:00.{round(1e3 * t):03d}" for t in STAMPS]
    check(read(table(f"{name};q", stamps), time=name), 36000.0)
    units = table(f"{name};q", stamps).replace("q\n", "q\nh;mm\n")
    check(read(units, time=name, units_row=True), 36000.0)


WINDOWS_NAN = ["1.#QNAN", "-1.#IND", "1.#INF", "-1.#INF00", "1.#SNAN", "1.#QO", "-1.#IO", "1,#INF", "-nan(ind)"]


@pytest.mark.parametrize("text", WINDOWS_NAN)
def test_what_windows_writes_for_no_number_is_missing(text: str) -> None:
    sensors = [*SENSORS, Sensor("r", "axle_acceleration", "m/s^2", axle=0)]
    log = read(f"time_s;q;r\n0.00;1;1\n0.01;{text};2\n0.02;3;{text}\n0.03;4;5\n", sensors)
    np.testing.assert_array_equal(log.channels[0].value, [1e-3, np.nan, 3e-3, 4e-3])
    np.testing.assert_array_equal(log.channels[1].value, [1.0, 2.0, np.nan, 5.0])


@pytest.mark.parametrize("mark", ["#", "%"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_only_lines_that_begin_with_a_mark_are_comments(mark: str, encoding: str) -> None:
    rows = [f"{t};{mark}{k} {mark};{v}" for k, (t, v) in enumerate(zip(STAMPS, VALUES, strict=True))]
    note = f"{mark} gear 2; with more; cells; than columns"
    text = "\n".join([f"{mark} truck 7", "time_s;event;q", note, *rows[:2], f" {note}", note, *rows[2:], note])
    check(read_log(InputFile(Path("log.csv"), text.encode(encoding)), "log.csv", SENSORS, STEP_S))
    with pytest.raises(DataRejectedError, match=r"column 'q' has '2.0 . gear', expected a number"):
        read(text.replace("2.0", f"2.0 {mark} gear"))


def test_comments_as_long_as_the_pieces_that_are_read_hide_no_rows() -> None:
    note = "".join(f"# {i} {'x' * 90}\n" for i in range(9000))
    rows = [f"{t};{v}\n" for t, v in zip(STAMPS, VALUES, strict=True)]
    check(read("time_s;q\n" + note.join(rows)))


@pytest.mark.parametrize("start", [45413.4166666, 0.4166666, 0.0])
def test_day_numbers_of_spreadsheets_are_refused(start: float) -> None:
    days = [f"{start + t / 86400.0:.10f}" for t in (0.0, 0.01, 0.02, 0.03)]
    with pytest.raises(DataRejectedError, match=r"counts days .* export the time in seconds"):
        read(table("time;q", days))


def test_a_format_by_name_is_taken() -> None:
    with pytest.raises(DataRejectedError, match="cannot be read as an MDF file"):
        read(table("time_s;q", STAMPS), format="mdf")
    check(read(table("time_s;q", STAMPS), name="log.mf4", format="csv"))


def test_a_second_column_named_like_time_may_hold_anything() -> None:
    rows = [f"{t};2024/05/01 10:00:00;{v}" for t, v in zip(STAMPS, VALUES, strict=True)]
    check(read("\n".join(["time_s;timestamp;q", *rows, ""])))


def test_a_table_with_a_suffix_of_bus_recordings_is_text() -> None:
    check(read(table("time_s;q", STAMPS), name="log.asc"))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_table_named_like_a_work_book_is_text(encoding: str) -> None:
    data = InputFile(Path("log.xls"), table("time_s;q", STAMPS).replace(";", "\t").encode(encoding))
    check(read_log(data, "log.xls", SENSORS, STEP_S))
    page = InputFile(Path("log.xls"), b"<html><table><tr><td>time_s</td></tr></table></html>")
    with pytest.raises(DataRejectedError, match=r"none of the columns of campaign.toml .*'<html>"):
        read_log(page, "log.xls", SENSORS, STEP_S)
