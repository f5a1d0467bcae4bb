"""From folders of results to populations, the file, the tables and the page."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from fleet_results import BROKEN, MEAN, NAMES, write_fleet_results
from hostile_text import HOSTILE
from selectolax.lexbor import LexborHTMLParser

from sysid.cli.main import cli
from sysid.errors import DataRejectedError
from sysid.fleet.assembly import StoredDraws, assemble
from sysid.fleet.draws import RECORD_FILE, record_digest
from sysid.fleet.hierarchy import HyperPriors
from sysid.fleet.index import schema_text, write_index
from sysid.fleet.instruments import instrument_problems
from sysid.fleet.key import file_digests, result_digest
from sysid.fleet.members import members
from sysid.fleet.outcome import read_outcome, write_outcome
from sysid.fleet.page import render_fleet, write_fleet_page
from sysid.fleet.read import read_fleet
from sysid.fleet.records import SharedError
from sysid.fleet.results import FleetResults, compute
from sysid.fleet.running import campaign_output
from sysid.fleet.status import rows_on_disk
from sysid.fleet.tables import TABLES, campaign_rows

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "fleet-tables.md"


def test_the_population_is_that_of_the_trucks(fleet_results: FleetResults) -> None:
    (found,) = fleet_results.populations
    assert found.names == NAMES[:4]
    assert found.truck_names == tuple(f"T{t + 1}" for t in range(6))
    inside = (found.mean.q05 < np.exp(MEAN[:4])) & (np.exp(MEAN[:4]) < found.mean.q95)
    assert inside.sum() >= 3
    assert found.outliers[0].truck == BROKEN[0]
    assert found.outliers[0].parameter == BROKEN[1]
    assert found.outliers[0].factor == pytest.approx(0.5, abs=0.1)
    # Every truck is drawn towards the others, and none beyond their mean.
    alone, drawn = (np.log(q.q50 / found.mean.q50) for q in (found.alone, found.trucks))
    assert 0.5 < np.abs(drawn).sum() / np.abs(alone).sum() < 0.98
    assert np.all(found.further > 0)
    assert np.isfinite(found.pareto_k).all()


def test_the_file_says_the_same_in_si(fleet_results: FleetResults) -> None:
    document = json.loads(fleet_results.file.read_text(encoding="utf-8"))
    (kind,) = document["types"]
    assert [p["name"] for p in kind["parameters"]] == list(NAMES[:4])
    assert 3e5 < kind["parameters"][0]["mean"]["q50"] < 5e5
    assert kind["outliers"][0]["truck"] == "T3"
    assert {load["axle"] for load in document["loads"]} == {1, 2}
    assert {load["shape"] for load in document["loads"]} == {"bump"}


def test_loads_are_those_of_a_new_truck(fleet_results: FleetResults) -> None:
    for load in fleet_results.loads:
        assert load.trucks == 6
        assert load.q05 < load.q50 < load.q95


def test_shared_errors_and_lost_records(fleet_folders: tuple[Path, Path], tmp_path: Path) -> None:
    fleet, output = read_fleet(fleet_folders[0]), tmp_path / "out"
    shutil.copytree(fleet_folders[1], output)
    (campaign_output(output, "T1-1") / "fleet_draws.npz").write_bytes(b"damaged")
    scales = SharedError("scales", 0.01, {"stiffness": 1.0, "damping": 1.0}, tuple(f"T{t}-1" for t in range(1, 7)))
    of_type = members(fleet, output, "short truck")
    found = assemble(of_type, (scales,), HyperPriors())
    assert "without posterior draws, and so left out: T1-1" in found.remarks
    assert len(found.members) == 11
    assert found.data.moved.shape == (11, 4, 1)
    assert [bool(m.any()) for m in found.data.moved[:3]] == [False, True, False]
    wide = SharedError("too wide", 0.5, {"stiffness": 1.0}, ("T2-1",))
    doubtful = assemble(of_type, (wide,), HyperPriors())
    assert any("too narrow to allow for 'too wide'" in r for r in doubtful.remarks)
    assert doubtful.data.moved[1, :, 0].tolist() == [1.0, 1.0, 0.0, 0.0]
    draws = StoredDraws(found.members, found.data.names)
    assert len(draws) == 11
    assert draws[0].names == NAMES[:4]
    few = type(fleet)("", fleet.folder, fleet.trucks[:2])
    with pytest.raises(DataRejectedError, match="a population needs 3"):
        assemble(members(few, output, "short truck"), (), HyperPriors())


def test_the_page_is_whole_and_links_to_the_campaigns(fleet_results: FleetResults, fleet_folders) -> None:
    page = LexborHTMLParser(render_fleet(fleet_results, list(rows_on_disk(fleet_results.fleet, fleet_folders[1]))))
    assert page.css_first("h1").text() == "Small fleet"
    links = [
        a.attributes["href"] for a in page.css("#campaigns ~ .scroll a, section a") if "report" in a.attributes["href"]
    ]
    assert "campaigns/T1-1/report.html" in links
    assert len(set(links)) == 12
    assert "T3: c_2 is 0." in page.css_first(".warnings").text()
    numbers = [node.text() for node in page.css("figcaption > b")]
    assert numbers == [f"Figure {i}." for i in range(1, len(numbers) + 1)]
    # Two suspensions by k and c, shrinkage, loads.
    assert len(numbers) == 4
    assert page.css("img, link, iframe") == []
    widths = {len(row.css("th, td")) for row in page.css_first("table").css("tr")}
    assert len(widths) == 1


def test_instruments_whose_channels_are_not_good_are_named(fleet_results: FleetResults, fleet_folders) -> None:
    rows = list(rows_on_disk(fleet_results.fleet, fleet_folders[1]))
    (problem,) = instrument_problems(rows, fleet_folders[1])
    quality = json.loads((campaign_output(fleet_folders[1], "T1-1") / "result.json").read_text())["quality"]
    assert [(c["channel"], c["verdict"]) for c in quality] == [(problem.channel, "rejected")]
    assert problem.campaigns == tuple(row.campaign for row in rows)
    assert (problem.records, problem.rejected, problem.message) == (12, 12, quality[0]["messages"][0])
    page = LexborHTMLParser(render_fleet(fleet_results, rows, [problem]))
    (shown,) = [t for t in page.css("table") if "by instrument" in t.css_first("caption").text()]
    cells = [cell.text(strip=True) for cell in shown.css("tbody tr")[0].css("th, td")]
    assert cells[0] == problem.channel
    assert cells[1] == "suspension deflection"
    assert cells[3].startswith("12 of 12")
    assert cells[4:] == ["12", "12"]
    healthy = LexborHTMLParser(render_fleet(fleet_results, rows)).css_first("main").text()
    assert "All channels of the finished campaigns are good." in healthy


def test_words_of_users_are_no_elements(fleet_results: FleetResults, tmp_path: Path, fleet_folders) -> None:
    folder, _ = write_fleet_results(tmp_path, title=HOSTILE[:200], prefix=HOSTILE[:40])
    hostile = read_fleet(folder)
    changed = FleetResults(hostile, fleet_results.populations, fleet_results.loads, (HOSTILE,), fleet_results.file)
    page = LexborHTMLParser(render_fleet(changed, list(rows_on_disk(hostile, fleet_folders[1]))))
    assert len(page.css("script")) == 1
    assert not [n for n in page.css("*") if any(k.lower().startswith("on") for k in n.attributes)]


def test_every_column_is_documented_and_the_version_goes_up_with_them() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for table, columns in TABLES.items():
        part = text.split(f"## {table}\n")[1].split("\n## ")[0]
        assert re.findall(r"^\| `(\w+)` \| ([^|]+) \|", part, re.MULTILINE) == [
            (name, f"{kind}") for name, (kind, _) in columns.items()
        ]
    assert json.loads(schema_text())["schema"] == 1


def test_the_tables_hold_the_results_and_answer_the_ten_questions(fleet_folders: tuple[Path, Path]) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    fleet = read_fleet(fleet_folders[0])
    folder = write_index(fleet, fleet_folders[1])
    parameters = pq.read_table(folder / "parameters.parquet").to_pandas()
    assert set(pq.read_table(folder / "channels.parquet").to_pandas().verdict) == {"rejected"}
    document = json.loads((campaign_output(fleet_folders[1], "T1-1") / "result.json").read_text())
    assert len(parameters) == 12 * len(document["parameters"])
    first = parameters[(parameters.campaign == "T1-1") & (parameters.name == "k_1")].iloc[0]
    assert first.value == document["parameters"][0]["least_squares"]["value"]
    crossed = pq.read_table(folder / "predictions.parquet").to_pandas()
    assert set(crossed["shape"]) == {"bump"}
    assert set(crossed.shape_sha256) == {document["predictions"][0]["shape"]["sha256"]}
    draws = pq.read_table(folder / "draws.parquet").to_pandas()
    assert set(draws.name) == set(NAMES)
    assert {len(v) for v in draws["values"]} == {100}
    assert pq.read_schema(folder / "draws.parquet").metadata[b"sysid_fleet_schema"] == b"1"
    duckdb = pytest.importorskip("duckdb")
    db = duckdb.connect()
    for table in TABLES:
        db.execute(f"CREATE VIEW {table} AS SELECT * FROM '{folder / f'{table}.parquet'}'")
    questions = re.findall(r"```sql\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    assert len(questions) == 10
    for question in questions:
        db.execute(question).fetchall()


def judged_fleet(fleet_folders, tmp_path, verdicts):
    """A copy of the fleet whose result.json of some campaigns have a verdict; a copied outcome knows their hash."""
    output = tmp_path / "judged"
    shutil.copytree(fleet_folders[1], output)
    for name, verdict in verdicts.items():
        file = campaign_output(output, name) / "result.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {"verdict": verdict}))
        write_outcome(file.parent, replace(read_outcome(file.parent), result_sha256=result_digest(file)))
    return output


VERDICTS = {
    "T1-1": {"trust": "do_not_bet", "reasons": ["Walkers are stuck <b>.", "More."]},
    "T2-1": {"trust": "use_within", "reasons": ["Wide."]},
    "T3-1": None,
    "T4-1": {"trust": "<script>"},
}


def test_the_tables_hold_the_verdict_of_every_campaign(fleet_folders: tuple[Path, Path], tmp_path: Path) -> None:
    output = judged_fleet(fleet_folders, tmp_path, VERDICTS)
    fleet = read_fleet(fleet_folders[0])
    rows = {row.campaign: row for row in rows_on_disk(fleet, output)}
    of = {name: campaign_rows(rows[name], campaign_output(output, name), output) for name in ("T1-1", "T2-1", "T3-1")}
    for name, trust, reason in (
        ("T1-1", "do_not_bet", "Walkers are stuck <b>."), ("T2-1", "use_within", "Wide."), ("T3-1", None, None),
    ):  # fmt: skip
        (campaign,) = of[name]["campaigns"]
        assert (campaign["verdict"], campaign["verdict_reason"]) == (trust, reason)
        for table in ("parameters", "predictions"):
            assert {line["verdict"] for line in of[name][table]} == {trust}


def test_the_page_shows_the_verdicts_and_lists_those_that_forbid(
    fleet_results: FleetResults, fleet_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    output = judged_fleet(fleet_folders, tmp_path, VERDICTS)
    rows = list(rows_on_disk(fleet_results.fleet, output))
    page = LexborHTMLParser(write_fleet_page(fleet_results, rows, output).read_text(encoding="utf-8"))
    tables = {t.css_first("caption").text(): t for t in page.css("table") if t.css_first("caption") is not None}
    (doubtful,) = [t for caption, t in tables.items() if "nobody should bet" in caption]
    (line,) = [[c.text() for c in r.css("th, td")] for r in doubtful.css("tbody tr")]
    assert line == ["1", "T1-1", "done", "do not bet", "Walkers are stuck <b>."]
    listed = {
        r.css("th")[0].text(): [c.text() for c in r.css("td")]
        for r in tables["Campaigns and their reports"].css("tbody tr")
    }
    assert {name: cells[4] for name, cells in listed.items() if name in VERDICTS} == {
        "T1-1": "do not bet", "T2-1": "use within", "T3-1": "", "T4-1": "",
    }  # fmt: skip


def test_unfinished_campaigns_are_in_the_tables_too(fleet_folders: tuple[Path, Path], tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    output = tmp_path / "out"
    shutil.copytree(fleet_folders[1], output)
    shutil.rmtree(campaign_output(output, "T2-1"))
    folder = write_index(read_fleet(fleet_folders[0]), output)
    campaigns = pq.read_table(folder / "campaigns.parquet").to_pandas().set_index("campaign")
    assert campaigns.loc["T2-1", "state"] == "queued"
    assert len(members(read_fleet(fleet_folders[0]), output, "short truck").campaigns) == 11


def calibrated(folder: Path, output: Path, name: str, **changes: str) -> Path:
    """A campaign folder whose files the outcome of this name was computed from; `changes` of the outcome."""
    campaign = folder / name
    campaign.mkdir()
    for file in ("campaign.toml", "run.csv"):
        (campaign / file).write_text(f"{file} of {name}")
    place = campaign_output(output, name)
    inputs = file_digests(campaign, ["campaign.toml", "run.csv"])
    write_outcome(place, replace(read_outcome(place), inputs=inputs, **changes))
    return campaign


@pytest.mark.usefixtures("quick_sampling")
def test_results_of_changed_campaigns_do_not_count_and_doubtful_ones_are_named(tmp_path: Path) -> None:
    folder, output = write_fleet_results(tmp_path)
    changed, gone = (calibrated(folder, output, f"T1-{n}") for n in (1, 2))
    calibrated(folder, output, "T2-1", status="preview")
    calibrated(folder, output, "T2-2", status="not_converged", state="not converged")
    (changed / "campaign.toml").write_text("axle loads corrected")
    (gone / "run.csv").unlink()
    result = CliRunner().invoke(cli, ["fleet", "report", str(folder), "--output", str(output)])
    assert result.exit_code == 0, result.output
    document = json.loads((output / "fleet_population.json").read_text(encoding="utf-8"))
    assert [c["name"] for c in document["types"][0]["campaigns"]][:2] == ["T1-2", "T2-1"]
    assert {load["trucks"] for load in document["loads"]} == {6}
    said = [
        "short truck: campaign T1-1 is left out: it has changed since it was calibrated (campaign.toml); run the fleet "
        "again",
        "short truck: 1 campaign with results of a preview (--quick), whose intervals are not reliable: T2-1",
        "short truck: 1 campaign whose sampling has not converged: T2-2",
        "short truck: 1 campaign whose files are missing in part or all, so that it is not known whether they have "
        "changed: T1-2",
    ]
    assert document["remarks"] == said
    page = LexborHTMLParser((output / "fleet.html").read_text(encoding="utf-8")).body.text()
    result = CliRunner().invoke(cli, ["fleet", "population", str(folder), "--output", str(output)])
    for sentence in said:
        assert sentence in page
        assert sentence in " ".join(result.stdout.split())


def test_a_type_that_lacks_trucks_says_which_have_changed(tmp_path: Path) -> None:
    folder, output = write_fleet_results(tmp_path, trucks=3)
    for name in ("T1-1", "T1-2"):
        (calibrated(folder, output, name) / "run.csv").write_text("another log")
    result = CliRunner().invoke(cli, ["fleet", "population", str(folder), "--output", str(output)])
    assert result.exit_code == 3
    assert "Type 'short truck' has 2 trucks with draws" in result.stderr
    assert "each of 2 campaigns (T1-1 and T1-2) is left out: it has changed since it was calibrated (run.csv)" in (
        result.stderr
    )


def test_a_campaign_on_which_nobody_should_bet_counts_only_if_asked_for(
    fleet_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    forbidden = {"trust": "do_not_bet", "reasons": ["The model does not explain the data."]}
    output = judged_fleet(fleet_folders, tmp_path, {"T1-1": forbidden, "T1-2": forbidden, "T2-1": forbidden})
    fleet = read_fleet(fleet_folders[0])
    without = members(fleet, output, "short truck")
    assert {m.campaign for m in without.campaigns}.isdisjoint({"T1-1", "T1-2", "T2-1"})
    assert len(without.campaigns) == 9
    assert without.remarks == (
        "each of 3 campaigns (T1-1, T1-2 and T2-1) is left out: nobody should bet on its numbers",
    )
    asked = members(fleet, output, "short truck", with_doubtful=True)
    assert len(asked.campaigns) == 12
    assert asked.remarks == (
        "3 campaigns on whose numbers nobody should bet; they count all the same: T1-1, T1-2 and T2-1",
    )


def test_a_campaign_that_counts_although_nobody_should_bet_is_marked(
    fleet_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    """A remark names some of many; the file and the page mark all."""
    forbidden = {"trust": "do_not_bet", "reasons": ["No."]}
    names = {f"T{t}-{c}" for t in range(1, 6) for c in (1, 2)} - {"T2-2"}
    output = judged_fleet(fleet_folders, tmp_path, dict.fromkeys(names, forbidden))
    results = compute(fleet_folders[0], output, lambda *_: None, with_doubtful=True)
    (kind,) = json.loads(results.file.read_text(encoding="utf-8"))["types"]
    assert {c["name"] for c in kind["campaigns"] if c["doubtful"]} == names
    assert len(kind["campaigns"]) == 12
    page = LexborHTMLParser(render_fleet(results, results.rows))
    (table,) = (t for t in page.css("table") if "drawn towards the population" in t.text())
    marked = [row.css_first("th").text() for row in table.css("tbody tr")]
    assert [("do not bet" in words, words[:2]) for words in marked] == [(t < 6, f"T{t}") for t in range(1, 7)]


def test_a_result_that_was_edited_counts_nowhere(fleet_folders: tuple[Path, Path], tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    output = tmp_path / "out"
    shutil.copytree(fleet_folders[1], output)
    file = campaign_output(output, "T2-1") / "result.json"
    document = json.loads(file.read_text())
    document["parameters"][0]["least_squares"]["value"] *= 10.0
    document["verdict"] = {"trust": "use", "reasons": []}
    file.write_text(json.dumps(document))
    (campaign_output(output, "T3-1") / "result.json").unlink()
    fleet = read_fleet(fleet_folders[0])
    states = {row.campaign: row for row in rows_on_disk(fleet, output)}
    assert {name for name, row in states.items() if row.state == "changed"} == {"T2-1", "T3-1"}
    assert "not the one that was computed" in states["T2-1"].outcome.sentence
    left = members(fleet, output, "short truck")
    assert {"T2-1", "T3-1"}.isdisjoint(m.campaign for m in left.campaigns)
    assert any("T2-1 and T3-1" in remark for remark in left.remarks)
    tables = write_index(fleet, output)
    assert {"T2-1", "T3-1"}.isdisjoint(pq.read_table(tables / "parameters.parquet")["campaign"].to_pylist())
    campaigns = pq.read_table(tables / "campaigns.parquet").to_pandas().set_index("campaign")
    assert campaigns.loc["T2-1", "state"] == "changed"
    assert pd.isna(campaigns.loc["T2-1", "verdict"])
    # What holds the same and was written again, with other times, is the same result.
    good = campaign_output(output, "T4-1") / "result.json"
    good.write_text(json.dumps({**json.loads(good.read_text()), "timings": {"fit": 99.0}}, indent=2))
    assert {row.campaign: row.state for row in rows_on_disk(fleet, output)}["T4-1"] == "done"


def test_draws_of_another_campaign_count_nowhere(fleet_folders: tuple[Path, Path], tmp_path: Path) -> None:
    """Whole and with the right checksum, but not those of this campaign's result."""
    fleet, output = read_fleet(fleet_folders[0]), tmp_path / "out"
    shutil.copytree(fleet_folders[1], output)
    for name in ("T2-1", "T3-1"):
        place = campaign_output(output, name)
        files = {
            "file_sha256": file_digests(place, ["result.json"])["result.json"],
            "draws_sha256": record_digest(place),
        }
        write_outcome(place, replace(read_outcome(place), **files))
    assert {row.state for row in rows_on_disk(fleet, output)} == {"done"}
    shutil.copy(campaign_output(output, "T3-1") / RECORD_FILE, campaign_output(output, "T2-1") / RECORD_FILE)
    states = {row.campaign: row for row in rows_on_disk(fleet, output)}
    assert {name for name, row in states.items() if row.state == "changed"} == {"T2-1"}
    assert states["T2-1"].outcome.sentence == f"its {RECORD_FILE} is missing or not the one that was computed"
    assert "T2-1" not in {m.campaign for m in members(fleet, output, "short truck").campaigns}


def test_status_is_told_from_facts(fleet_folders: tuple[Path, Path], tmp_path: Path) -> None:
    fleet, output = read_fleet(fleet_folders[0]), tmp_path / "out"
    shutil.copytree(fleet_folders[1], output)
    for name in ("T1-1", "T1-2"):
        place = campaign_output(output, name)
        (place / "fleet_outcome.json").unlink()
        (place / "fleet_progress.json").write_text('{"stage": "fit", "fraction": 0.5}')
    script = (
        "import sys\nfrom pathlib import Path\nfrom sysid.fleet.task import _marked_as_running\n"
        "with _marked_as_running(Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", script, str(campaign_output(output, "T1-2"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        states = {row.campaign: row.state for row in rows_on_disk(fleet, output)}
        assert (states["T1-1"], states["T1-2"], states["T2-1"]) == ("interrupted", "running", "done")
        assert "campaign T1-2 is left out: a process works on it" in members(fleet, output, "short truck").remarks
        process.kill()
    assert {row.campaign: row.state for row in rows_on_disk(fleet, output)}["T1-2"] == "interrupted"


@pytest.mark.parametrize("trucks", [1, 2])
def test_one_or_two_trucks_have_a_page_too(tmp_path: Path, trucks: int) -> None:
    folder, output = write_fleet_results(tmp_path, trucks=trucks)
    done = CliRunner().invoke(cli, ["fleet", "report", str(folder), "--output", str(output)])
    assert done.exit_code == 0, done.output
    page = LexborHTMLParser((output / "fleet.html").read_text(encoding="utf-8"))
    assert f"has {trucks} trucks with draws; a population needs 3." in page.css_first("main").text()
    assert len({a.attributes["href"] for a in page.css("a") if "report" in a.attributes["href"]}) == 2 * trucks
    # The files that the page names are there.
    assert {"fleet_status.csv", "fleet_population.json"} <= {p.name for p in output.iterdir()}
    refused = CliRunner().invoke(cli, ["fleet", "population", str(folder), "--output", str(output)])
    assert refused.exit_code == 3


def test_one_sentence_about_many_campaigns_is_said_once(
    fleet_results: FleetResults, fleet_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    same = {"trust": "use_within", "reasons": ["The range of damper speeds is short."]}
    names = [f"T{t}-{c}" for t in range(1, 7) for c in (1, 2)]
    output = judged_fleet(fleet_folders, tmp_path, dict.fromkeys(names, same))
    page = write_fleet_page(fleet_results, list(rows_on_disk(fleet_results.fleet, output)), output).read_text()
    assert page.count("The range of damper speeds is short.") == 1
    assert "T1-1, T1-2, T2-1, T2-2, T3-1, T3-2 and 6 more" in page
