"""The page of a test day: what it shows, and to whom."""

from __future__ import annotations

import http.client
import re
import socket
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from small_results import small_campaign, small_history

from sysid.errors import OutputError
from sysid.estimation.residuals.run_history import RunHistory
from sysid.watch import DayReport, KnownAxle, KnownValue, LogVerdict, PlannedTest, StopRule
from sysid.watch.knowledge import axle_states
from sysid.watch.last_run import LastRun, last_run
from sysid.watch.page import day_page, day_part
from sysid.watch.server import PageServer
from sysid.workflow import store

RULE = StopRule(0.02, 0.05)
GOOD = LogVerdict("a.csv", "run, empty, 16 km/h", "good")
DEAD = LogVerdict("b<script>.csv", "run, empty, 24 km/h", "repeat", ("lvdt1: the sensor is dead.",))
NEXT = PlannedTest("bump_run", ("c.csv",), "empty", 32.0, "", "run, empty, 32 km/h", there=False)


def known(axle: int, k: float | None, c: float | None, older: bool = False) -> KnownAxle:
    """What is known of an axle: k of 1000 kN/m and c of 10 kN s/m with these half widths."""
    values = (None if w is None else KnownValue(v, w, "fit", older) for v, w in ((1e6, k), (1e4, c)))
    return KnownAxle(axle, f"axle {axle}", None, *values)


REPORT = DayReport(
    new=(GOOD,), logs=(GOOD,), remarks=(), growing=(), planned=(NEXT,),
    known=(known(1, 0.015, 0.04), known(2, 0.015, 0.2, older=True), known(3, None, 0.04)),
    computing="", enough=False, missing=("c of axle 2 is known within 20 %; asked: 5 %.",), next_tests=("Next.",),
)  # fmt: skip


RUN = LastRun(small_history(), small_history().columns[0], 1.25)


class _Words(HTMLParser):
    """Texts of a page, and its tags."""

    def __init__(self, text: str):
        super().__init__()
        self.texts: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append(data.strip())


def words(report: DayReport | None, *last: LogVerdict) -> list[str]:
    return _Words(day_part(report, last, None, RULE)).texts


def test_an_axle_is_known_when_both_values_are() -> None:
    assert axle_states(REPORT.known, RULE) == {1: "known", 2: "wide", 3: "unknown"}
    # In two load cases the worse one counts.
    assert axle_states((known(1, 0.01, 0.01), known(1, 0.01, 0.2)), RULE) == {1: "wide"}


def test_the_first_line_is_what_to_do_now() -> None:
    assert words(None) == ["Waiting for the first log."]
    assert words(REPORT)[0] == "Next: run, empty, 32 km/h"
    assert words(replace(REPORT, logs=(GOOD, DEAD)))[0] == "Repeat: run, empty, 24 km/h"
    done = replace(REPORT, planned=(replace(NEXT, there=True),))
    assert words(done)[0] == "Next."
    assert words(replace(done, computing="fit"))[0] == "All tests are there: wait for the result."
    assert words(replace(done, enough=True))[0] == "Enough: stop."


def test_values_signs_and_reasons() -> None:
    found = words(replace(REPORT, logs=(GOOD, DEAD)), DEAD)
    assert {"1,000 ± 1.5 %", "10 ± 4 %", "10 ± 20 %*", "–"} <= set(found)
    assert [t for t in found if t.startswith(("●", "◐", "○"))] == ["● known", "◐ too wide", "○ not known"]
    assert "✗ REPEAT THIS TEST" in found
    assert "lvdt1: the sensor is dead." in found
    assert any("* without the last logs" in text for text in found)


def test_the_log_to_repeat_comes_first() -> None:
    odd = replace(GOOD, file="odd.csv", answer="look")
    found = words(replace(REPORT, logs=(GOOD, odd, DEAD)), GOOD, odd, DEAD)
    assert found.index("✗ REPEAT THIS TEST") < found.index("! look at this")
    assert "✓ good" not in found


def test_a_name_of_a_log_is_text() -> None:
    page = _Words(day_part(replace(REPORT, logs=(DEAD,)), (DEAD,), None, RULE))
    assert "script" not in page.tags
    assert any("b<script>.csv" in text for text in page.texts)


def test_the_truck_says_in_words_what_its_colours_say() -> None:
    vehicle = small_campaign().vehicle
    part = day_part(REPORT, (GOOD,), vehicle, RULE)
    assert "axle 1: known; axle 2: too wide" in part
    assert ("#7ddfb0" in part, "#ffc94d" in part) == (True, True)


def test_the_last_run_is_measured_over_simulated() -> None:
    part = day_part(REPORT, (GOOD,), None, RULE, RUN)
    assert "Measured and simulated" in part
    assert f"{RUN.history.file}: the channel that the fit meets least, by 1.2 times the noise" in part
    assert "Measured and simulated" not in day_part(REPORT, (GOOD,), None, RULE)


@dataclass(frozen=True)
class _Fit:
    other: float
    histories: tuple[RunHistory, ...]


@dataclass(frozen=True)
class _Kept:
    fit: _Fit


def test_the_run_that_landed_last_and_the_channel_with_most_residual_over_noise(tmp_path: Path) -> None:
    """Residual scales of 2, 3 and 9 over noises of 1, 0 (unknown) and 3: the largest known ratio is 3."""
    first, second = (replace(small_history(repeat=n), noise_sd=np.array([2.0, 3.0, 9.0])) for n in (1, 2))
    noise = {"instrument_noise_sd": np.array([1.0, 0.0, 2.0]), "rolling_noise_sd": np.array([0.0, 0.0, 3.0])}
    histories = (replace(first, **noise), replace(second, **noise))
    (tmp_path / "stages").mkdir()
    assert last_run(tmp_path, ()) is None
    store.save(tmp_path / "stages" / "fit.npz", _Kept(_Fit(1.0, histories)), "x", _Kept)
    for landed, file in (((first.file, second.file), second.file), ((second.file, "drop.csv", first.file), first.file)):
        found = last_run(tmp_path, landed)
        assert found is not None
        assert (found.history.file, found.column, found.misfit) == (file, first.columns[2], 3.0)
    (tmp_path / "stages" / "fit.npz").write_bytes(b"damaged")
    assert last_run(tmp_path, ()) is None


@pytest.fixture
def server() -> Iterator[PageServer]:
    found = PageServer(day_page)
    found.show("<h1>one</h1>")
    found.start()
    yield found
    found.stop()


def ask(server: PageServer, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def test_the_page_asks_for_nothing_from_elsewhere(server: PageServer) -> None:
    with urllib.request.urlopen(server.address, timeout=20) as answer:
        page = answer.read().decode("utf-8")
        assert answer.headers["Cache-Control"] == "no-store"
    assert "default-src &#39;none&#39;" in page
    assert "connect-src &#39;self&#39;" in page
    assert not {"img", "iframe", "form"} & set(_Words(page).tags)
    # Without an icon browsers ask for one.
    assert re.findall(r"<link [^>]*>", page) == ['<link rel="icon" href="data:,">']
    assert "://" not in page


def test_the_part_changes_and_is_sent_once(server: PageServer) -> None:
    path = server.address.split(str(server.port))[1]
    first = ask(server, f"{path}part")
    assert (first.status, first.read()) == (200, b"<h1>one</h1>")
    tag = first.headers["ETag"]
    assert ask(server, f"{path}part", **{"If-None-Match": tag}).status == 304
    server.show("<h1>two</h1>")
    assert ask(server, f"{path}part", **{"If-None-Match": tag}).read() == b"<h1>two</h1>"


def test_nobody_else_is_answered(server: PageServer) -> None:
    path = server.address.split(str(server.port))[1]
    # Another site whose name points to this machine, and who does not know the address.
    assert ask(server, path, Host=f"example.org:{server.port}").status == 403
    assert [ask(server, p).status for p in ("/", "/part", f"{path}../", f"{path}other")] == [404] * 4
    assert server.address.startswith("http://127.0.0.1:")
    bound = server._server.socket.getsockname()
    assert bound[0] == "127.0.0.1"


def test_a_port_that_is_taken_is_said() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OutputError, match="choose another --port"):
            PageServer(day_page, taken.getsockname()[1])
