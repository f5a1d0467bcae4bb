"""First looks at the logs of the shipped campaign, whose campaign file says what is true: right, or marked."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from studies.first_look.judging import Score, judged
from studies.first_look.variants import VARIANTS, Variant, write_variant
from sysid.campaign.statics import check_statics
from sysid.campaign.toml.reading import validate
from sysid.campaign.toml.vehicle_tables import VehicleReader
from sysid.cli.main import cli
from sysid.errors import CampaignError, DataRejectedError
from sysid.first_look import campaign_text, first_look, template, template_names
from sysid.first_look.folder import names_in
from sysid.first_look.templates import template_text

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "examples" / "linear_truck"


def score(title: str, folder: Path) -> Score:
    variant = next(v for v in VARIANTS if v.title == title)
    return judged(write_variant(DATA, folder / "logs", variant), None)


def test_the_shipped_logs_are_read_without_a_person(tmp_path: Path) -> None:
    found = score("as it is", tmp_path)
    assert (found.columns, found.right, found.marked, found.silent) == (21, 21, 0, [])
    assert (found.tests, found.tests_right, found.tests_silent) == (28, 28, [])
    assert found.vehicle == "lowboy6"
    # Eight values from the person who weighed and measured, and the check passes.
    assert (found.to_fill, found.check) == (8, 0)


def test_a_place_stands_once(tmp_path: Path) -> None:
    written = write_variant(DATA, tmp_path / "logs", Variant(""))
    text = campaign_text(first_look(written.folder, None), "logs", "campaign.toml")
    assert text.count("x_m = ") == 6 + 1  # axles and hinge
    # They rest on the same arrivals and are asked for once.
    assert text.count("TODO confirm: x_m of axles 2, 3, 4, 5, 6, by arrivals") == text.count("; measure") == 1
    frames = [s for s in tomllib.loads(text)["sensors"]["bump_run"].values() if s["kind"] == "body_acceleration"]
    assert [s["axle"] for s in frames] == [axle["name"] for axle in template("lowboy6").axles]


def test_speeds_that_names_alone_tell_are_asked_for_once(tmp_path: Path) -> None:
    look = first_look(write_variant(DATA, tmp_path / "logs", Variant("")).folder, None)

    def asked(numbers: tuple[int, ...], *more: str) -> tuple[list[str], int]:
        runs = [e for e in look.tests if e.kind == "bump_run"]
        doubtful = {runs[n].file: replace(runs[n], sure=False, why=("speed by its name alone", *more)) for n in numbers}
        text = campaign_text(replace(look, tests=tuple(doubtful.get(e.file, e) for e in look.tests)), "", "c.toml")
        tests = text[text.index("bump_run = [") :].splitlines()
        marked = [line for line in tests if line.endswith("# speed by its name alone")]
        return [line for line in tests if "TODO confirm" in line], len(marked)

    (line,), marked = asked((2, 5, 7))
    assert line.strip() == "# TODO confirm: speed by its name alone of 3 runs below"
    assert marked == 3
    # One alone says it in its line, and so does a run with another doubt.
    (line,), marked = asked((2,))
    assert "file = " in line
    assert marked == 0
    lines, marked = asked((2, 5), "its axles arrive as at 3.0 km/h")
    assert len(lines) == 3
    assert all("its axles arrive as at 3.0 km/h" in line for line in lines[1:])
    assert marked == 0


@pytest.mark.parametrize(
    ("title", "marked"),
    [
        ("columns ch01, ch02, ..., shuffled", 21),
        ("accelerations in m/s^2 under names with g", 14),
        ("one axle sensor upside down", 1),
        ("all sensors of one axle upside down", 3),
        ("no frame sensors", 0),
    ],
)
def test_what_names_do_not_say_the_behaviour_does(title: str, marked: int, tmp_path: Path) -> None:
    found = score(title, tmp_path)
    assert (found.right, found.marked, found.silent) == (found.columns, marked, [])
    assert (found.tests_right, found.tests_silent, found.check) == (28, [], 0)


def test_exchanged_columns_are_seen_and_put_right(tmp_path: Path) -> None:
    found = score("two columns exchanged by name", tmp_path)
    assert (found.right, found.silent, found.check) == (21, [], 0)
    assert found.marked >= 4


def test_drops_without_names_say_that_their_axle_is_not_known(tmp_path: Path) -> None:
    variant = Variant("", names="anonymous", anonymous_files=True)
    look = first_look(write_variant(DATA, tmp_path / "logs", variant).folder)
    assert [e.kind for e in look.tests] == ["plank_drop"] * 18 + ["bump_run"] * 10
    assert {e.axle for e in look.tests} == {None}
    assert not any(e.sure for e in look.tests)
    # Speeds by the arrivals and the positions of the template that fits: those of the linear truck.
    speeds = sorted(e.speed_km_h for e in look.tests if e.speed_km_h is not None)
    assert speeds == pytest.approx([8.0, 8.0, 16.0, 16.0, 16.0, 16.0, 24.0, 24.0, 32.0, 32.0], rel=0.05)
    text = campaign_text(look, "logs", "campaign.toml")
    assert text.count("TODO: axle on the plank") == 18
    assert "# TODO confirm: no path says a load case" in text


def test_speeds_of_a_truck_that_rubs_and_hits_its_stops_are_right_or_not_given(tmp_path: Path) -> None:
    variant = Variant("", names="anonymous", anonymous_files=True)
    look = first_look(write_variant(ROOT / "data", tmp_path / "logs", variant).folder)
    assert [e.kind for e in look.tests] == ["plank_drop"] * 18 + ["bump_run"] * 10
    speeds = [e.speed_km_h for e in look.tests if e.speed_km_h is not None]
    assert len(speeds) >= 5
    for speed in speeds:
        assert min(abs(speed / nominal - 1.0) for nominal in (8.0, 16.0, 24.0, 32.0)) < 0.05


def test_positions_come_from_speeds_in_names_and_headings_from_the_crest(tmp_path: Path) -> None:
    look = first_look(write_variant(DATA, tmp_path / "logs", VARIANTS[0]).folder)
    true = tomllib.loads((DATA / "campaign.toml").read_text(encoding="utf-8"))
    expected = sorted(axle["x_m"] for axle in true["vehicle"]["axle"])
    assert look.positions_m == pytest.approx(expected, abs=0.15)
    (scan,) = look.scans
    assert scan.heading_deg == pytest.approx(true["scan"]["heading_deg"], abs=0.2)
    assert (scan.points, scan.unit) == (36_000, "m")


def test_heights_along_the_road_take_the_place_of_a_scan(tmp_path: Path) -> None:
    folder = write_variant(DATA, tmp_path / "logs", VARIANTS[0]).folder
    (scan,) = first_look(folder).scans
    (folder / scan.file).unlink()
    assert "# without a scanner" in campaign_text(first_look(folder), "", "campaign.toml")
    (folder / "levelled.csv").write_text("station_m,height_m\n0,0\n0.4,0.06\n0.8,0.08\n1.2,0.05\n1.6,0\n")
    look = first_look(folder)
    (profile,) = look.scans
    assert (profile.file, profile.points, profile.extent, profile.levelled) == ("levelled.csv", 5, (1.6, 0.08), True)
    table = tomllib.loads(campaign_text(look, "", "campaign.toml"))["scan"]
    assert table == {"profile": "levelled.csv"}


def test_a_given_vehicle_keeps_its_positions_and_says_what_the_arrivals_say(tmp_path: Path) -> None:
    folder = write_variant(DATA, tmp_path / "logs", VARIANTS[0]).folder
    text = campaign_text(first_look(folder, "lowboy6"), "logs", "campaign.toml")
    assert "x_m = 4.07" in text
    assert text.count("TODO confirm: x_m of axles 2, 3, 4, 5, 6, assumed, arrivals agree") == 1
    assert "vehicle chosen by" not in text


@pytest.mark.parametrize("name", template_names())
def test_a_template_is_a_vehicle_that_stands_on_its_scales(name: str) -> None:
    tables = tomllib.loads(template_text(name))
    rest = {"schema": 1, "campaign": {"title": name}, "acquisition": {"sample_interval_s": 0.005}, "sensors": {}}
    reader = VehicleReader(validate(rest | tables, name), name)
    for case in reader.load_cases.values():
        check_statics(reader.vehicle, case)
    assert set(reader.load_cases) == {"empty", "laden"}
    chosen = template(name)
    assert "ssumed" in chosen.source
    assert chosen.positions_m[0] == 0.0
    assert name in next(p.help or "" for p in cli.commands["init"].params if p.name == "vehicle")


def test_the_lowboy_is_the_linear_truck() -> None:
    true = tomllib.loads((DATA / "campaign.toml").read_text(encoding="utf-8"))
    chosen = template("lowboy6")
    assert chosen.load_cases["empty"] == true["load_case"]["unloaded"]
    assert chosen.load_cases["laden"] == true["load_case"]["loaded"]
    assert chosen.vehicle["axle"] == true["vehicle"]["axle"]


def test_a_vehicle_that_there_is_not_is_named() -> None:
    with pytest.raises(CampaignError, match="There is no vehicle 'rigit3'; did you mean 'rigid3'"):
        template("rigit3")


def _log(rows: int = 400, *, header: str = "time_s,axle1_accel_g,lvdt1_mm") -> str:
    lines = [f"{0.005 * i:.3f},{0.001 * (i % 7)},{0.1 * (i % 5)}" for i in range(rows)]
    return "\n".join([header, *lines]) + "\n"


def test_an_unreadable_file_is_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    (tmp_path / "run_10kmh.csv").write_text(_log(), encoding="utf-8")
    (tmp_path / "broken.mf4").write_bytes(b"MDF     4.10    broken")
    (tmp_path / "profile.csv").write_text("place_m,height_m\n0.0,0.0\n0.1,0.02\n0.2,0.0\n0.3,0.0\n", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("the dog slept\n", encoding="utf-8")
    look = first_look(tmp_path)
    assert [log.file for log in look.logs] == ["run_10kmh.csv"]
    assert len(look.messages) == 2
    assert any(m.startswith("broken.mf4 cannot be read as an MDF file") for m in look.messages)
    assert not any("object at" in m for m in look.messages)
    assert any(m.startswith("profile.csv has no column of time") for m in look.messages)


def test_a_text_named_like_a_work_book_is_a_log(tmp_path: Path) -> None:
    (tmp_path / "run_10kmh.xls").write_text(_log().replace(",", "\t"), encoding="utf-8")
    (tmp_path / "page.xls").write_text("<html><table><tr><td>1</td></tr></table></html>", encoding="utf-8")
    look = first_look(tmp_path)
    assert [log.file for log in look.logs] == ["run_10kmh.xls"]
    assert look.messages == ("page.xls is a text without a table of numbers; export it as CSV.",)


def test_where_no_log_can_be_read_the_last_reason_is_said(tmp_path: Path) -> None:
    (tmp_path / "broken.mf4").write_bytes(b"MDF     4.10    broken")
    with pytest.raises(DataRejectedError, match=r"holds no log that can be read \(1 file.*broken.mf4 cannot be read"):
        first_look(tmp_path)


def _two_loggers(folder: Path, *, runs_on: bool, same_names: bool) -> None:
    """Four runs of the linear truck, the trailer's sensors in logs of a second logger that is 0.2 s behind."""
    for k, file in enumerate(sorted((DATA / "bump_runs").glob("*.csv"))[:4]):
        table = pd.read_csv(file)
        second = [c for c in table.columns if any(n in c for n in ("4", "5", "6"))]
        for name, columns, late in (("tractor", table.columns.difference(second, sort=False), 0.0),
                                    ("trailer", ["time_s", *second], 0.2)):  # fmt: skip
            part = table[list(columns)].assign(time_s=table["time_s"] + (120.0 * k - late if runs_on else 0.0))
            if same_names and name == "trailer":
                part.columns = [c.translate(str.maketrans("456", "123")) for c in part.columns]
            (folder / name).mkdir(parents=True, exist_ok=True)
            part.to_csv(folder / name / file.name, index=False)


@pytest.mark.parametrize(("runs_on", "clock"), [(True, "continuous"), (False, "per_log")])
def test_logs_of_two_loggers_are_joined_by_their_names(runs_on: bool, clock: str, tmp_path: Path) -> None:
    _two_loggers(tmp_path / "logs", runs_on=runs_on, same_names=False)
    look = first_look(tmp_path / "logs")
    assert [logger.name for logger in look.loggers] == ["tractor", "trailer"]
    assert len(look.tests) == 4
    text = campaign_text(look, "logs", "campaign.toml")
    made = tomllib.loads(text)
    assert made["logger"][1]["clock"] == clock
    assert text.count("[[logger]]") == 2
    assert "clock is the reference" in text
    for run in made["tests"]["bump_run"]:
        assert run["files"]["trailer"] == run["files"]["tractor"].replace("tractor/", "trailer/")
    of_trailer = {c for c, s in made["sensors"]["bump_run"].items() if s.get("logger") == "trailer"}
    true = tomllib.loads((DATA / "campaign.toml").read_text(encoding="utf-8"))["sensors"]["bump_run"]
    assert of_trailer == {c for c in true if any(n in c for n in ("4", "5", "6"))}
    # Right, and to be confirmed: nothing but names says an axle across clocks.
    for column, sensor in true.items():
        found = made["sensors"]["bump_run"][column]
        assert found["kind"] == sensor["kind"]
        assert sensor.get("axle") in (None, found["axle"])
    assert not any(s.sure for s in look.run_sensors if s.column in of_trailer)


def test_axles_of_loggers_with_the_same_names_are_left_to_a_person(tmp_path: Path) -> None:
    _two_loggers(tmp_path / "logs", runs_on=True, same_names=True)
    made = tomllib.loads(campaign_text(first_look(tmp_path / "logs"), "logs", "campaign.toml"))
    sensor = made["sensors"]["bump_run"]["trailer lvdt1_mm"]
    assert (sensor["logger"], sensor["column"]) == ("trailer", "lvdt1_mm")
    assert sensor["axle"].startswith("TODO")


def test_repeats_by_letters_are_no_loggers(tmp_path: Path) -> None:
    for k, file in enumerate(sorted((DATA / "bump_runs").glob("*.csv"))[:4]):
        (tmp_path / f"empty_{16 + 8 * (k // 2)}kmh_{'ab'[k % 2]}.csv").write_bytes(file.read_bytes())
    look = first_look(tmp_path)
    assert look.loggers == ()
    assert len(look.tests) == 4


def test_foreign_times_units_and_text_columns(tmp_path: Path) -> None:
    rows = "\n".join(f"{0.005 * i:.3f};{i % 7},5;ok;{(i % 5)},25".replace(".", ",") for i in range(400))
    (tmp_path / "fahrt_10kmh_leer.csv").write_text(
        f"Messung 7\nZeit [s];Beschl. Achse 1;Status;Federweg 1\ns;g;;mm\n{rows}\n", encoding="latin-1"
    )
    look = first_look(tmp_path)
    (log,) = look.logs
    assert (log.time, log.text) == (None, ("Status",))
    assert {x.name: x.unit for x in log.looks} == {"Beschl. Achse 1": "g", "Federweg 1": "mm"}
    assert log.rate_hz == pytest.approx(200.0)
    # A reader that finds names and units needs no key for them.
    acquisition = tomllib.loads(campaign_text(look, "x", "campaign.toml"))["acquisition"]
    assert acquisition.keys() == {"sample_interval_s", "filter"}


def test_names_that_toml_has_to_quote_come_back_as_they_are(tmp_path: Path) -> None:
    column = 'axle 1 "left" \\ \x7f acc [g]'
    quoted = '"' + column.replace('"', '""') + '"'
    (tmp_path / "run 10kmh 'a'.csv").write_text(_log(header=f"time_s,{quoted},speed \x01 kmh"), encoding="utf-8")
    text = campaign_text(first_look(tmp_path), "x", "campaign.toml")
    tables = tomllib.loads(text)
    assert tables["sensors"]["bump_run"]["speed \x01 kmh"] == {"kind": "speed", "unit": "km/h"}
    assert column in tables["sensors"]["bump_run"]
    assert tables["tests"]["bump_run"][0]["file"] == "run 10kmh 'a'.csv"


def test_two_sensors_of_one_place_are_its_sides(tmp_path: Path) -> None:
    for name in ("case1_unloaded_16kmh_run1", "case4_loaded_8kmh_run1"):
        table = pd.read_csv(DATA / "bump_runs" / f"{name}.csv")
        sides = {"time_s": table["time_s"]}
        for column in table.columns[1:7]:
            sides |= {f"{column[:-3]}_L_mm": 1.01 * table[column], f"{column[:-3]}_R_mm": 0.99 * table[column]}
        for column in table.columns[7:13]:
            sides |= {f"{column[:-2]}_L_g": 1.01 * table[column], f"{column[:-2]}_R_g": 0.99 * table[column]}
        pd.DataFrame(sides).to_csv(tmp_path / f"{name}.csv", index=False)
    look = first_look(tmp_path)
    assert len(look.run_sensors) == 24
    for sensor in look.run_sensors:
        assert sensor.side == ("left" if "_L_" in sensor.column else "right")
        assert f"{sensor.axle + 1}_" in sensor.column
        assert sensor.sure, sensor


def test_results_below_the_folder_are_no_logs(tmp_path: Path) -> None:
    for name in ("run.csv", "output/stages/timings.json", "output/predictions/empty_48kmh.csv", "stages/slow.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("a")
    # A person may call a folder of logs so too.
    assert names_in(tmp_path) == (["run.csv", "stages/slow.csv"], [])


def test_names_that_are_left_out_are_said(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "run_10kmh.csv").write_text(_log(), encoding="utf-8")
    (logs / "run\n20kmh.csv").write_text(_log(), encoding="utf-8")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "run_30kmh.csv").write_text(_log(), encoding="utf-8")
    (logs / "more").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    (logs / "again").symlink_to(logs, target_is_directory=True)
    look = first_look(logs)
    assert [log.file for log in look.logs] == ["run_10kmh.csv"]
    link = (
        "is a link to a folder and is not followed: a campaign reads no files outside its folder; copy the logs there."
    )
    assert set(look.messages) == {
        f"again {link}",
        f"more {link}",
        "run\\n20kmh.csv has control characters in its name and is left out; rename it.",
    }
    (logs / "run_10kmh.csv").unlink()
    with pytest.raises(DataRejectedError, match="holds no log that can be read"):
        first_look(logs)


def test_names_that_are_no_utf8_are_said(tmp_path: Path) -> None:
    file, below = (os.fsencode(tmp_path) + name for name in (b"/Lkw_M\xfcller_30kmh.csv", b"/M\xe4rz"))
    try:
        Path(os.fsdecode(file)).write_text(_log(), encoding="utf-8")
    except OSError:
        pytest.skip("this file system takes no such names")
    Path(os.fsdecode(below)).mkdir()
    (Path(os.fsdecode(below)) / "run_20kmh.csv").write_text(_log(), encoding="utf-8")
    (tmp_path / "run_10kmh.csv").write_text(_log(), encoding="utf-8")
    look = first_look(tmp_path)
    assert [log.file for log in look.logs] == ["run_10kmh.csv"]
    assert set(look.messages) == {
        r"Lkw_M\xfcller_30kmh.csv has a name that is no UTF-8 and is left out; rename it.",
        r"M\xe4rz has a name that is no UTF-8 and is left out; rename it.",
    }
