"""The report in a real browser without network: accessibility, console, layout, interaction (`make test-browser`)."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.browser

TOOLS = Path(__file__).parent / "browser"
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")


@pytest.fixture(scope="module")
def seen(tmp_path_factory, full_text):
    if shutil.which("node") is None or not Path(CHROMIUM).exists():
        pytest.skip("needs node and chromium")
    if not (TOOLS / "node_modules").is_dir():
        pytest.skip("run npm install in tests/report/browser first")
    report = tmp_path_factory.mktemp("page") / "report.html"
    report.write_text(full_text, encoding="utf-8")
    command = ["node", "check.mjs", str(report)]
    done = subprocess.run(command, cwd=TOOLS, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_axe_finds_nothing(seen):
    for size, found in seen["axe"].items():
        assert found["violations"] == [], size
        assert found["rules_passed"] > 30


def test_page_is_silent_and_asks_for_nothing(seen):
    assert seen["console"] == []
    assert seen["requests"] == []


def test_page_fits_phone_and_laptop(seen):
    assert {size: found["overflow_px"] for size, found in seen["sizes"].items()} == {"phone": 0, "laptop": 0}


def test_run_and_channel_can_be_chosen_and_values_read(seen):
    explorer = seen["explorer"]
    assert (explorer["runs"], explorer["channels"]) == (2, 3)
    assert explorer["redrawn"]
    assert explorer["reading"].startswith("At ")
    assert "simulated" in explorer["reading"]
