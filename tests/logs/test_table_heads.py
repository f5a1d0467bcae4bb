"""What loggers write between the names of columns and the first numbers, and how they write numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import Sensor, read_log
from sysid.campaign.inputs.logs import LogWriting
from sysid.errors import DataRejectedError
from sysid.logs.channels import LogRequest
from sysid.logs.input_file import InputFile
from sysid.logs.registry import read_channels

SENSORS = (Sensor("q", "suspension_deflection", "mm", axle=0), Sensor("a", "axle_acceleration", "g", axle=0))
STEP_S = 0.005
ROWS = [(STEP_S * i, 0.25 * i - 10.0, 0.5 - 0.01 * i) for i in range(100)]


def body(between: str = ",", decimal: str = ".", form: str = "{:.3f}", quote: str = "", factor: float = 1.0) -> str:
    def cell(x: float) -> str:
        return quote + form.format(x).replace(".", decimal) + quote

    return "".join(between.join([cell(t * factor), cell(q), cell(a)]) + "\n" for t, q, a in ROWS)


def read(text: str | bytes, sensors=SENSORS, **writing):
    data = text if isinstance(text, bytes) else text.encode()
    return read_log(InputFile(Path("log.csv"), data), "log.csv", sensors, STEP_S, LogWriting(**writing))


def check(log) -> None:
    q, a = log.channels
    np.testing.assert_allclose(q.time_s, [t for t, _, _ in ROWS], atol=1e-9)
    np.testing.assert_allclose(q.value, [1e-3 * v for _, v, _ in ROWS], atol=1e-9)
    np.testing.assert_allclose(a.value, [9.80665 * v for _, _, v in ROWS], atol=1e-9)


STAMPED = "".join(f'"2024-05-06 10:05:{t:06.3f}",{i},{q},{a}\n' for i, (t, q, a) in enumerate(ROWS)).replace(".000", "")
HEADS = {
    "names": "time_s,q,a\n" + body(),
    "units": "time,q,a\ns,mm,g\n" + body(),
    "units of time": "time,q,a\nms,mm,g\n" + body(factor=1e3),
    "units in brackets, a blank row (PicoScope)": "Time,q,a\n(ms),(mm),(g)\n\n" + body(factor=1e3),
    "units and two blank rows, quoted (MoTeC)": '"Format","x",,"y"\n"Venue",\n\n"Time","q","a"\n"s","mm","g"\n\n\n'
    + body(quote='"'),
    "units and numbers of the channels (AiM)": '"Format","x"\n\n"Time","q","a"\n"s","mm","g"\n"1","2","3"\n\n'
    + body(quote='"'),
    "units and processing (Campbell)": '"TOA5","CR6","4711"\n"TIMESTAMP","RECORD","q","a"\n"TS","RN","mm","g"\n'
    '"","","Smp","Avg"\n' + STAMPED,
    "words, then units": "time,q,a\nStart,vorne links,Achse\n[ms],[mm],[g]\n" + body(factor=1e3),
    "sections (Racelogic)": "File created on 13/07/2024\n\n[header]\ntime\nq\n\n[column names]\nsats time q a\n"
    "[data]\n" + "".join(f"009 {t:.3f} {q} {a}\n" for t, q, a in ROWS),
    "names behind a mark of comment (numpy)": "# time_s q a\n" + body(" ", form="{:.18e}"),
    "names with blanks between wide columns": "Time [s]    q        a\n" + body("   "),
    "white space and decimal comma": "time_s\tq\ta\n".replace("\t", "   ") + body("   ", ","),
    "quoted decimal commas": "time_s,q,a\n" + body(",", ",", quote='"'),
    "separator said (Excel)": "sep=;\ntime_s;q;a\n" + body(";"),
    "typographic minus": "time_s;q;a\n" + body(";").replace("-", "\u2212"),
    "dash for minus": ("time_s;q;a\n" + body(";").replace("-", "\u2013")).encode("cp1252"),
    "Windows code page": ("Messung \u201eMai\u201c\ntime_s;q;a\n" + body(";")).encode("cp1252"),
    "UTF-16": ("time_s\tq\ta\ns\tmm\tg\n" + body("\t")).encode("utf-16"),
}


@pytest.mark.parametrize("text", HEADS.values(), ids=HEADS)
def test_every_head_gives_the_same_numbers(text: str | bytes) -> None:
    check(read(text))


@pytest.mark.parametrize("case", ["units", "units and processing (Campbell)", "words, then units"])
def test_units_of_the_file_are_compared(case: str) -> None:
    text = HEADS[case].replace("mm", "cm")
    with pytest.raises(DataRejectedError, match=r"the file says that 'q' is in 'cm', campaign.toml says 'mm'"):
        read(text)


@pytest.mark.parametrize("case", ["units", "units and processing (Campbell)"])
def test_a_declared_row_of_units_is_the_first_one(case: str) -> None:
    check(read(HEADS[case], units_row=True))


def test_the_names_of_a_file_with_units_are_listed() -> None:
    content = read_channels(InputFile(Path("log.csv"), HEADS["units"].encode()), "log.csv", LogRequest(()))
    assert content.names == ("time", "q", "a")


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("broken", "correct or empty the cell"),
        ("2024-05-06", "it is a date or a time without seconds"),
        ("10:05:00.5", "it is a time"),
        ('"-1,234.5"', "without commas between thousands"),
    ],
)
def test_a_first_row_that_is_no_number_gets_the_hint_of_its_cause(cell: str, said: str) -> None:
    """A fault among numbers is no row of units."""
    text = "time_s,q,a\n" + body().replace("-10.000", cell, 1)
    with pytest.raises(DataRejectedError) as error:
        read(text)
    assert f"row 2, column 'q' has '{cell.strip(chr(34))}'" in str(error.value)
    assert said in str(error.value)
    assert "units_row" not in str(error.value)


@pytest.mark.parametrize("space", ["\u00a0", "\u202f", "\u2009", " ", "'", "\u2019"])
def test_thousands_may_be_set_apart_by_a_space_or_an_apostrophe(space: str) -> None:
    rows = "".join(f"{0.005 * i:.3f};{-1 - i}{space}234{space}567,5;0\n".replace(".", ",") for i in range(9))
    log = read("time_s;q;a\n" + rows)
    np.testing.assert_allclose(log.channels[0].value, [-1e-3 * ((1 + i) * 1e6 + 234567.5) for i in range(9)])
    # Two numbers are no thousands.
    with pytest.raises(DataRejectedError, match="expected a number"):
        read("time_s;q;a\n" + rows.replace(f"{space}234{space}567", f"{space}23{space}56"))


def test_over_range_is_missing() -> None:
    log = read("time_s;q;a\n" + body(";").replace("-10.000", "-\u221e", 1).replace("-9.750", "\u221e", 1))
    assert np.isnan(log.channels[0].value).tolist() == [True, True] + [False] * 98


# ---------------------------------------------------------------------- empty cells between white space

COLUMNS = "    time_s           q           a\n"


def fixed(without: dict[int, int], rows=ROWS) -> str:
    """Columns of fixed width; `without`: place of the empty cell by row."""

    def cells(row: int) -> str:
        return "".join(" " * 12 if without.get(row) == at else f"{v:12.3f}" for at, v in enumerate(rows[row]))

    return COLUMNS + "".join(cells(row) + "\n" for row in range(len(rows)))


@pytest.mark.parametrize("place", [1, 2])
def test_an_empty_cell_between_white_space_moves_no_reading(place: int) -> None:
    """The cells behind it would be read under the names of those before them."""
    check(read(fixed({})))
    with pytest.raises(DataRejectedError, match="row 7 has 2 cells between white space under 3 names"):
        read(fixed({5: place, 9: place}))


def test_a_last_row_that_was_cut_is_none() -> None:
    q, a = read(fixed({99: 2})).channels
    assert np.isnan(a.value[-1])
    assert q.value[-1] == pytest.approx(1e-3 * ROWS[99][1])
    # Blank rows and comments are no rows with empty cells.
    lines = fixed({}).splitlines(keepends=True)
    check(read("".join([*lines[:50], "# trigger\n", *lines[50:], "\n\n"])))


# ---------------------------------------------------------------------- units in the names of columns


@pytest.mark.parametrize(("name", "unit", "clash"), [
    ("q [m]", "mm", "m"), ("q (cm)", "mm", "cm"), ("q [mm]", "m", "mm"), ("q [mV]", "mm", "mV"),
    ("q [mm]", "mm", None), ("q [V]", "mm", None), ("q (left)", "mm", None), ("q [m] raw", "mm", None),
])  # fmt: skip
def test_a_unit_in_the_name_of_a_column_is_what_the_file_says(name: str, unit: str, clash: str | None) -> None:
    """One letter may be a place: V is ``vorn``, and a scale says what a bare signal means."""
    text = f"time_s,{name},a\n" + body()
    sensors = (Sensor(name, "suspension_deflection", unit, axle=0), SENSORS[1])
    if clash is None:
        assert read(text, sensors).channels[0].sensor.column == name
        return
    with pytest.raises(DataRejectedError, match=f"is in '{clash}', campaign.toml says '{unit}'"):
        read(text, sensors)
    scaled = Sensor(name, "suspension_deflection", unit, axle=0, scale=2.0)
    assert read(text, (scaled, SENSORS[1])).channels[0].value[0] == pytest.approx(
        ROWS[0][1] * 2.0 * {"m": 1.0, "mm": 1e-3}[unit]
    )
