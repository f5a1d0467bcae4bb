"""What a reader does not see and programs obey reaches no terminal, table, page, figure or keyword file."""

from __future__ import annotations

import io

import pytest
from rich.live import Live
from rich.text import Text

from sysid.cli.stages import PlainConsole
from sysid.cli.tables import render
from sysid.csv_cells import csv_text, escape_cell
from sysid.display import TextTable
from sysid.export.lsdyna import _comment
from sysid.plot.style import label
from sysid.report.skeleton import _environment
from sysid.wording import plain_line, plain_text

#: Controls of ISO 6429, and the characters with the property Bidi_Control (Unicode, PropList.txt).
CONTROLS = [chr(n) for n in (*range(0x00, 0x20), *range(0x7F, 0xA0))]
BIDI = [chr(n) for n in (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))]
SEPARATORS = ["\u2028", "\u2029"]
UNSEEN = [*CONTROLS, *BIDI, *SEPARATORS]
NAME = "truck " + "".join(f"{c}[31mA" for c in UNSEEN)
#: What names are made of, in several scripts.
READABLE = "Zug \u00e9\u00df \u0628\u0627\u0635 \u5361\u8f66 \u0917\u093e\u0921\u093c\u0940 \U0001f69a"
READABLE += " \u0646\u0645\u06cc\u200c\u062f\u0627\u0646\u0645"


def unseen_in(text: str, allowed: str = "") -> list[str]:
    return [f"U+{ord(c):04X}" for c in UNSEEN if c in text and c not in allowed]


def shown(terminal: bool) -> str:
    stream = io.StringIO()
    screen = PlainConsole(file=stream, force_terminal=terminal, color_system=None, highlight=False, width=4000)
    table = TextTable(NAME, ("campaign", NAME))
    table.add_row(NAME, READABLE)
    render(screen, [table, NAME])
    screen.print(NAME, markup=False)
    screen.print(Text(NAME))
    return stream.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_gets_nothing_to_obey(terminal: bool) -> None:
    assert unseen_in(shown(terminal), "\n") == []
    assert READABLE in shown(terminal)


def test_a_live_table_gets_nothing_to_obey() -> None:
    stream = io.StringIO()
    screen = PlainConsole(file=stream, force_terminal=True, color_system=None, width=4000)
    with Live(console=screen, transient=True) as live:
        live.update(Text("quiet"), refresh=True)
        quiet = stream.getvalue()
        live.update(Text(NAME), refresh=True)
    # The console itself moves the cursor, by the same sequences whatever it shows.
    assert unseen_in(stream.getvalue(), "".join(set(quiet)) + "\n\r\x1b") == []
    assert "\x1b[31m" not in stream.getvalue()


@pytest.mark.parametrize("character", UNSEEN, ids=lambda c: f"{ord(c):04X}")
def test_no_way_out_lets_a_character_through(character: str) -> None:
    name = f"left{character}right"
    page = _environment().from_string("<p>{{ name }}</p>").render(name=name)
    ways = {
        "text": plain_text(name),
        "figure": label(name),
        "SVG": plain_line(name),
        "CSV": csv_text(("name",), [[escape_cell(name)]]).removeprefix("name\n").removesuffix("\n"),
        "keyword file": "".join(_comment(name)),
        "page": page,
    }
    kept = {way for way, text in ways.items() if character in text}
    assert kept == ({"text", "page"} if character in "\n\t" else set())
    assert all("left" in text and "right" in text for text in ways.values())


def test_what_people_write_is_kept() -> None:
    assert plain_text(READABLE) == plain_line(READABLE) == READABLE
    assert escape_cell(READABLE) == READABLE


@pytest.mark.parametrize("sign", "=+-@\uff1d\uff0b\uff0d\uff20\ufe66\ufe62\ufe63\ufe6b\u2212")
@pytest.mark.parametrize("before", ["", "  ", "truck;", "truck; ", "a;b;", "\t", "\u202e"])
def test_no_cell_is_a_formula_in_any_country(sign: str, before: str) -> None:
    cell = escape_cell(f"{before}{sign}HYPERLINK(1)")
    # Where a spreadsheet ends cells at semicolons, each part is one.
    assert all(not part.lstrip().startswith(sign) for part in cell.split(";"))
    assert cell.endswith(f"{sign}HYPERLINK(1)")


def test_signs_inside_of_a_cell_stay() -> None:
    for text in ("front axle - left", "a=b", "12 + 3", "k_2[half-laden]", "a;b", "no. 7; second try"):
        assert escape_cell(text) == text
