"""What a terminal shows: tables of 80 columns, commands that paste, progress that never falls back, one answer."""

from __future__ import annotations

import io
import json
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console
from small_results import small_results

from sysid.cli import invocation
from sysid.cli.answer import show_run
from sysid.cli.main import cli
from sysid.cli.progress import StageProgress
from sysid.cli.tables import render, short_names, show_command
from sysid.display import TextTable
from sysid.prediction.quantiles import Quantiles
from sysid.progress import TimeLeft, time_words
from sysid.report.verdict import verdict
from sysid.results import Results
from sysid.workflow.stages.data import quality_blocks

ROOT = Path(__file__).parents[2]
DROPS = [f"Fallversuch_unbeladen_Achse{axle}_Wiederholung{repeat}.csv" for axle in (1, 2, 3) for repeat in (1, 2, 3)]


def printed(blocks, width: int = 80) -> list[str]:
    console = Console(width=width, record=True, file=io.StringIO())
    render(console, blocks)
    return console.export_text().splitlines()


@pytest.mark.parametrize("width", [18, 24, 40])
def test_long_names_stay_different_in_a_narrow_column(width: int) -> None:
    short = short_names(DROPS, width)
    assert max(map(len, short)) <= width
    assert len(set(short)) == len(DROPS)
    # The control: cut at the end, as a terminal does it, they are all alike.
    assert len({name[:width] for name in DROPS}) < len(DROPS)


def test_names_that_fit_and_folders_of_their_own_are_kept() -> None:
    assert short_names(["runs/a.csv", "drops/b.csv"], 20) == ["runs/a.csv", "drops/b.csv"]
    assert short_names([f"runs/{n}" for n in DROPS], 50)[0] == DROPS[0]


def test_a_wide_table_fits_into_80_columns_without_cutting_a_number() -> None:
    table = TextTable(
        "Drops", ("file", "channel", "period of the decay s", "decrement", "k kN/m", "c kN s/m", "verdict")
    )
    for i, name in enumerate(DROPS):
        table.add_row(
            name, "suspension_deflection", f"{0.51234 + i:.5f}", "0.8123 ± 0.012", "1234 ± 12", "9.87", "good"
        )
    lines = printed([table])
    assert max(map(len, lines)) <= 80
    assert all(sum(f"{0.51234 + i:.5f}" in line for line in lines) == 1 for i in range(len(DROPS)))
    assert sum("0.8123 ± 0.012" in line and "1234 ± 12" in line for line in lines) == len(DROPS)
    assert DROPS[0] in " ".join(printed([table], 200))


def test_a_command_is_one_line_that_a_shell_takes_apart_again() -> None:
    folder = "/data/Messung Halle 3/" + "sehr_langer_name_" * 6
    console = Console(width=80, record=True, file=io.StringIO())
    show_command(console, "Next", invocation.command_line("check", folder))
    (line,) = [line for line in console.export_text(styles=False).splitlines() if "check" in line]
    assert shlex.split(line)[-2:] == ["check", folder]


def test_the_next_command_has_campaign_folder_and_options_as_typed_and_no_preview() -> None:
    said = []

    @click.command("check")
    @click.argument("campaign", default="data")
    @click.option("--output", default="output")
    @click.option("--seed", type=int)
    @click.option("--quick", is_flag=True)
    def check(campaign: str, output: str, seed: int, quick: bool) -> None:
        said.append(invocation.next_command("run"))

    group = click.Group("main", commands=[check])
    CliRunner().invoke(group, ["check", "my truck", "--output", "my out", "--seed", "0", "--quick"], prog_name="sysid")
    CliRunner().invoke(group, ["check"], prog_name="sysid")
    assert shlex.split(said[0]) == ["sysid", "run", "my truck", "--output", "my out", "--seed", "0"]
    assert said[1] == "sysid run"


def test_a_module_is_called_as_one() -> None:
    done = subprocess.run([sys.executable, "-m", "sysid", "check", "no such"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr.startswith("python -m sysid check: There is no campaign file 'no such'")


def test_time_left_always_shrinks_and_is_silent_at_first() -> None:
    left = TimeLeft()
    assert left(1.0, 0.5) is None
    assert left(10.0, 0.01) is None
    left = TimeLeft()
    # Ten seconds for a tenth, then a part that takes far longer than its share, then the rest at once.
    shown = [left(t, f) for t, f in ((10.0, 0.1), (60.0, 0.11), (200.0, 0.12), (210.0, 0.9), (215.0, 0.99))]
    assert shown[0] == pytest.approx(90.0)
    assert shown[3] == pytest.approx(210.0 / 9.0)
    assert all(later < earlier for earlier, later in pairwise(shown))


def test_time_left_ends_with_the_work_where_the_machine_slows_down() -> None:
    # A tenth of the work in 10 s, the rest at a quarter of that pace until 370 s. Once the estimate is the true one,
    # ds/dt = -s / (370 - t): the ratio of shown and true time stays.
    left = TimeLeft()
    times = np.arange(10.0, 369.0, 1.0)
    shown = np.array([left(t, 0.1 + (t - 10.0) / 400.0) for t in times], float)
    assert np.all(np.diff(shown) < 0.0)
    ratio = shown / (370.0 - times)
    assert ratio[0] == pytest.approx(0.25)
    assert np.all((ratio > 0.2) & (ratio < 0.26))
    assert np.ptp(ratio[times > 200.0]) < 0.005


def test_words_of_the_time_left() -> None:
    assert [time_words(v) for v in (None, 240.0, 42.0, 1.0)] == [
        "", "about 4 min left", "about 40 s left", "about 10 s left",
    ]  # fmt: skip


def test_piped_progress_is_a_line_per_stage_and_never_falls_back() -> None:
    stream = io.StringIO()
    with StageProgress(Console(file=stream, width=200)) as progress:
        progress.stage("reading")
        for message, fraction in (
            ("1 of 2 fit", 0.0),
            ("1 of 2 fit: a, b", 0.6),
            ("1 of 2 fit: c", 0.3),
            ("2 of 2 x", 0.5),
        ):
            progress.update(message, fraction)
    assert stream.getvalue().splitlines() == ["reading ...", "1 of 2 fit ...", "2 of 2 x, 60 % ..."]


def test_piped_progress_breaks_a_long_silence(monkeypatch) -> None:
    monkeypatch.setattr("sysid.cli.progress.SILENCE_S", 0.2)
    stream = io.StringIO()
    with StageProgress(Console(file=stream, width=200)) as progress:
        progress.update("1 of 2 fit: searching", 0.2)
        progress._ended.wait(0.8)
    assert any(
        re.fullmatch(r"\d s: 1 of 2 fit: searching, 20 % \.\.\.", line) for line in stream.getvalue().splitlines()
    )


def answer(results: Results) -> str:
    return "\n".join(printed(show_run(results, Path("out") / "report.html")))


def test_the_answer_has_k_c_peak_load_verdict_report_and_next_command() -> None:
    results = small_results()
    text = answer(results)
    assert max(map(len, text.splitlines())) <= 80
    p = results.predictions.passes
    for axle, static in enumerate(p[0].static_load_N):
        peak = max(float(q.peak_ratio_q50[axle]) * float(q.static_load_N[axle]) for q in p)
        (line,) = [x for x in text.split("predicted pass")[1].splitlines() if x.startswith(f"{axle + 1} ")]
        assert f"{static / 1e3:.1f}" in line
        number = re.search(r"([\d.]+) ±", line)
        assert number is not None
        assert float(number[1]) == pytest.approx(peak / 1e3, rel=5e-3)
    stiffness = [row.best for row in results.suspension("stiffness")]
    half = (stiffness[0].high - stiffness[0].low) / 2e3
    (line,) = [x for x in text.split("Axle loads in")[0].splitlines() if x.startswith("1 ")][:1]
    shown = re.search(r"([\d.,]+) ± ([\d.]+)", line)
    assert shown is not None
    np.testing.assert_allclose([float(shown[1]), float(shown[2])], [stiffness[0].value / 1e3, half], rtol=0.02)
    # The sweep ends at 60 km/h with 1 + 0.2 * 60 / 3.6 times the static load of axle 2.
    highest = (1.0 + 0.2 * 60.0 / 3.6) * results.campaign.load_cases[p[0].load_case].axle_loads_kg[1]
    kilonewton = highest * results.campaign.vehicle.gravity_m_s2 / 1e3
    largest = re.compile(r"Only\s+computed:\s+([\d.]+)\s+(?:±\s+[\d.]+\s+)?kN\s+on\s+axle\s+2\s+\(\w+,\s+60\s+km/h\)\.")
    shown = largest.search(text)
    assert shown is not None
    assert float(shown[1]) == pytest.approx(kilonewton, abs=0.5)
    # Of its 10, 25 and 60 km/h the runs reached 30.
    kilonewton *= (1.0 + 0.2 * 25.0 / 3.6) / (1.0 + 0.2 * 60.0 / 3.6)
    within = re.search(r"Largest\s+as\s+driven:\s+([\d.]+)\s+(?:±\s+[\d.]+\s+)?kN\s+on\s+axle\s+2", text)
    assert within is not None
    assert float(within[1]) == pytest.approx(kilonewton, abs=0.5)
    of_driven = text.split("Axle loads as driven")[1].split("predicted pass")[0]
    (line,) = [x for x in of_driven.splitlines() if x.startswith("2 ")]
    assert float(re.findall(r"[\d.]+", line.split("axle", 1)[1])[1]) == pytest.approx(kilonewton, abs=0.5)
    assert "*" not in of_driven
    (sweep,) = results.predictions.sweeps
    flat = replace(sweep, peak_ratio=Quantiles(None, np.ones_like(sweep.peak_ratio.q50), None))
    changed = answer(replace(results, predictions=replace(results.predictions, sweeps=(flat,))))
    assert largest.search(changed) is None
    assert re.search(r"Only\s+computed:\s+\d+\s+±\s+\d+\s+kN\s+on\s+axle\s+2\s+\(empty,\s+48", changed)
    assert "Can you use k and c?" in text
    assert "Can you use the axle loads?" in text
    # The step is the report's.
    assert verdict(results).todo[0] in " ".join(text.split())
    assert "out/report.html" in text.replace("\\", "/")
    assert "calibrate.py" in text.splitlines()[-1]


def test_a_preview_asks_for_the_whole_run() -> None:
    import dataclasses

    text = answer(dataclasses.replace(small_results(), status="preview", judgement=None))
    assert "Not for decisions" in text
    assert text.splitlines()[-1].split()[-1] == "run"


def test_findings_of_one_kind_are_said_once_and_good_channels_counted() -> None:
    report = small_results().quality
    text = "\n".join(printed(quality_blocks(report)))
    good = sum(f.verdict == "good" for f in report.channels)
    assert f"{good} good" in text
    assert all(f.column not in text for f in report.channels if f.verdict == "good")


@pytest.mark.parametrize("slip", ["key", "name", "log", "missing"])
def test_a_slip_is_told_before_anything_heavy_is_loaded(tmp_path: Path, slip: str) -> None:
    text = (ROOT / "data" / "campaign.toml").read_text(encoding="utf-8")
    text = text.replace("\nname = ", "\nnmae = ", 1) if slip == "key" else text
    text = text.replace('load_case = "loaded"', 'load_case = "laoded"', 1) if slip == "name" else text
    if slip != "missing":
        (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    words = ["fit", str(tmp_path / "campaign.toml"), "--output", str(tmp_path / "o")]
    program = (
        "import sys\nfrom sysid.cli.main import cli\n"
        f"try:\n    cli({words!r})\n"
        "except SystemExit as ended:\n"
        "    heavy = {'jax', 'scipy', 'pandas', 'matplotlib', 'rich.progress'}\n"
        f"    heavy |= set() if {slip!r} in ('name', 'log') else {{'numpy', 'pydantic'}}\n"
        "    print(ended.code, sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.strip() == "2 []", done.stderr
    expected = {
        "key": "nmae",
        "name": "did you mean 'loaded'",
        "log": "which does not exist",
        "missing": "There is no campaign file",
    }[slip]
    assert expected in done.stderr
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("predict", "data", "--road", "B"), "--road needs a --speed"),
        (("predict", "data", "--speed", "60", "--load-case", "ful"), "it has unloaded, loaded"),
        (("predict", "data", "--speed", "60", "--bump", "mound"), "it has bump"),
        (("profile", "data", "--parameter", "k_9"), "axles 1 to 6"),
        (("validate", "data", "--leave-out", "nothing"), "none of the runs"),
        (("compare", "data", "nowhere"), "does not exist"),
        (("init", "nowhere"), "does not exist"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_options_that_the_campaign_file_contradicts_are_told_before_anything_is_read(
    tmp_path: Path, words: tuple[str, ...], expected: str
) -> None:
    output = () if words[0] == "init" else ("--output", str(tmp_path / "o"))
    program = (
        "import sys\nfrom sysid.cli.main import cli\n"
        f"try:\n    cli({[*words, *output]!r})\n"
        "except SystemExit as ended:\n"
        "    print(ended.code, sorted({'jax', 'pandas', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.strip() == "2 []", done.stderr
    assert expected in " ".join(done.stderr.split())
    assert not (tmp_path / "o").exists()


def test_the_help_loads_no_package_but_click() -> None:
    program = "import sys\nfrom sysid.cli.main import cli\ntry:\n    cli(['--help'])\nexcept SystemExit:\n    pass\n"
    program += "print(sorted({'numpy', 'pydantic', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_folder_of_logs_without_a_campaign_file_is_offered_init(tmp_path: Path) -> None:
    folder = tmp_path / "my logs"
    folder.mkdir()
    (folder / "a.csv").write_text("t,x\n0,1\n")
    result = CliRunner().invoke(cli, ["run", str(folder)], prog_name="sysid")
    assert result.exit_code == 2
    assert shlex.split(result.stderr.split("in it: ")[1]) == ["sysid", "init", str(folder)]


def test_json_is_the_document_and_nothing_else(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "sysid", "check", "data", "--output", str(tmp_path / "o"), "--json"],
        capture_output=True, text=True, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    written = json.loads((tmp_path / "o" / "result.json").read_text(encoding="utf-8"))
    # Writing the file is timed too.
    assert document | {"timings": {}} == written | {"timings": {}}
    assert document["schema"] == 1
