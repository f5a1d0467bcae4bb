"""The page of a test day in a real browser: accessibility, console, requests, layout, and whether it follows."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_results import small_campaign
from test_day_page import DEAD, GOOD, REPORT, RULE, RUN

from sysid.watch.page import day_page, day_part
from sysid.watch.server import PageServer

pytestmark = pytest.mark.browser

TOOLS = Path(__file__).parents[1] / "report" / "browser"


@pytest.fixture(scope="module")
def seen() -> dict[str, Any]:
    if shutil.which("node") is None or not Path(os.environ.get("CHROMIUM", "/usr/bin/chromium")).exists():
        pytest.skip("needs node and chromium")
    if not (TOOLS / "node_modules").is_dir():
        pytest.skip("run npm install in tests/report/browser first")
    vehicle = small_campaign().vehicle
    bad = replace(REPORT, logs=(GOOD, DEAD))
    server = PageServer(day_page)
    server.show(day_part(bad, (GOOD, DEAD), vehicle, RULE, RUN))
    server.start()
    shots = [os.environ["SCREENSHOTS"]] if "SCREENSHOTS" in os.environ else []
    command = ["node", "check_day.mjs", server.address, *shots]
    try:
        with subprocess.Popen(
            command, cwd=TOOLS, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stdout.readline() == "shown\n"
            server.show(day_part(replace(REPORT, enough=True), (GOOD,), vehicle, RULE))
            process.stdin.write("go on\n")
            process.stdin.flush()
            return dict(json.loads(process.stdout.readline()))
    finally:
        server.stop()


def test_the_page_follows_the_day(seen: dict[str, Any]) -> None:
    assert (seen["first"], seen["then"]) == ("Repeat: run, empty, 24 km/h", "Enough: stop.")


def test_it_is_silent_and_asks_this_machine_alone(seen: dict[str, Any]) -> None:
    assert seen["console"] == []
    assert seen["requests"] == []


def test_it_is_one_screen_and_fits_a_phone(seen: dict[str, Any]) -> None:
    assert {size: found["overflow_px"] for size, found in seen["sizes"].items()} == {"phone": 0, "laptop": 0}
    assert seen["sizes"]["laptop"]["height_px"] <= 768


def test_axe_finds_nothing_on_it(seen: dict[str, Any]) -> None:
    assert seen["axe"] == {"phone": [], "laptop": []}
