"""Passes named on the command line: what they become, and what is said about incomplete ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_results import small_campaign

from sysid.cli.main import cli
from sysid.errors import CampaignError, DataRejectedError
from sysid.workflow.requested_passes import OPTIONS, requested_passes

CAMPAIGN = replace(small_campaign(), scans={"one": None, "two": None})


def test_without_options_the_campaign_decides():
    assert requested_passes(CAMPAIGN, dict.fromkeys(OPTIONS)) == ()
    assert requested_passes(CAMPAIGN, {"speeds": ()}) == ()


def test_every_speed_is_a_pass():
    found = requested_passes(CAMPAIGN, {"speeds": (36.0, 48.0), "load_case": "laden", "bump": "two"})
    assert [(r.load_case, r.bump, r.shape) for r in found] == [("laden", "two", None)] * 2
    assert [r.speed_m_s for r in found] == pytest.approx([10.0, 48.0 / 3.6])
    (first,) = requested_passes(CAMPAIGN, {"speeds": (36.0,)})
    assert (first.load_case, first.bump) == ("empty", "one")


def test_a_shape_needs_no_scan():
    options = {"speeds": (36.0,), "shape": "trapezoid", "height": 0.1, "length": 6.0, "top": 2.0}
    (found,) = requested_passes(small_campaign(), options)
    assert (found.shape.name, found.shape.height_m, found.shape.length_m, found.shape.top_m) == (
        "trapezoid", 0.1, 6.0, 2.0,
    )  # fmt: skip
    assert found.bump == found.shape.label


def test_a_file_is_a_bump_that_no_run_crossed(tmp_path, monkeypatch):
    path = tmp_path / "site" / "hump.csv"
    path.parent.mkdir()
    path.write_text("station_m,height_m\n0,0\n1,0.1\n2,0\n")
    (found,) = requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": str(path)})
    name = "site/hump.csv"
    assert (found.bump, found.shape.source, found.shape.heights_m) == (name, name, (0.0, 0.1, 0.0))
    monkeypatch.chdir(path.parent)
    assert requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": "hump.csv"})[0].bump == "hump.csv"
    # A scan of the campaign comes before a file of the same name.
    assert requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": "one"})[0].shape is None
    path.write_text("")
    with pytest.raises(DataRejectedError, match="is empty"):
        requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": str(path)})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"load_case": "laden"}, "--load-case needs a --speed"),
        ({"shape": "watts"}, "--shape needs a --speed"),
        ({"speeds": (30.0,), "load_case": "half"}, "'half' is not in the campaign; it has empty, laden"),
        ({"speeds": (30.0,), "bump": "three"}, "it has one, two"),
        ({"speeds": (30.0,), "bump": "three.crg"}, "neither a scan of the campaign nor a file; the campaign has"),
        ({"speeds": (30.0,), "bump": "x" * 5000 + ".crg"}, "neither a scan"),
        ({"speeds": (30.0,), "bump": "one", "lateral": 1.0}, "name that file by --bump"),
        ({"speeds": (30.0,), "lateral": 1.0}, "name that file by --bump"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1, "length": 3.0, "lateral": 1.0}, "name that file"),
        ({"speeds": (30.0,), "height": 0.1}, "size of a --shape"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1}, "add --height and --length"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1, "length": 3.0, "top": 1.0}, "--top belongs to"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1, "length": 3.0, "bump": "one"}, "--bump and --shape"),
    ],
)
def test_what_is_missing_is_said(options, said):
    with pytest.raises(CampaignError, match=said.replace("(", r"\(")):
        requested_passes(CAMPAIGN, options)


def test_a_campaign_without_a_scan_needs_a_shape():
    with pytest.raises(CampaignError, match="no scan of a bump"):
        requested_passes(small_campaign(), {"speeds": (30.0,)})


def test_the_command_line_offers_exactly_these_options():
    names = {p.name for p in cli.commands["predict"].params} - {p.name for p in cli.commands["fit"].params}
    assert names == set(OPTIONS)


def test_a_class_is_a_road():
    options = {"speeds": (80.0,), "road": "b", "length": 1000.0, "seed": 3, "realisations": 2}
    (found,) = requested_passes(CAMPAIGN, options)
    road = found.road
    assert (road.roughness, road.length_m, road.seed, road.realisations) == ("B", 1000.0, 3, 2)
    assert found.bump == road.label == "road class B, 1000 m, seeds 3 to 4"
    assert requested_passes(CAMPAIGN, {"speeds": (80.0,), "road": "A"})[0].road.length_m == 500.0


def test_a_file_is_a_road_without_its_grade(tmp_path):
    """Ten millimetres high, on a grade of 5 %, with uneven stations, in millimetres."""
    path = tmp_path / "lane.csv"
    station = np.cumsum(np.full(2001, 0.02))
    height = 0.01 * np.sin(2 * np.pi * station / 4.0)
    rows = [f"{s:.4f},{1e3 * (z + 0.05 * s):.4f}" for s, z in zip(station, height, strict=True)]
    path.write_text("\n".join(["station_m,height_mm", *rows]))
    (found,) = requested_passes(CAMPAIGN, {"speeds": (80.0,), "road": str(path)})
    assert found.road.length_m == pytest.approx(40.0)
    assert found.road.step_m == pytest.approx(0.02)
    np.testing.assert_allclose(found.road.height_m[0], height - height[0], atol=2e-5)
    (short,) = requested_passes(CAMPAIGN, {"speeds": (80.0,), "road": str(path), "length": 10.0})
    assert short.road.length_m == pytest.approx(10.0)


def test_hills_are_no_roughness(tmp_path):
    """A kilometre with a hill of 20 m: its waves of 5 m stay, to a tenth of a millimetre away from the ends."""
    path = tmp_path / "hill.csv"
    station = 0.05 * np.arange(20001)
    wave = 0.005 * np.sin(2 * np.pi * station / 5.0)
    rows = [f"{s:.2f},{z + 20.0 * np.sin(np.pi * s / 1000.0):.6f}" for s, z in zip(station, wave, strict=True)]
    path.write_text("\n".join(["station_m,height_m", *rows]))
    road = requested_passes(CAMPAIGN, {"speeds": (80.0,), "road": str(path)})[0].road
    middle = slice(4000, -4000)
    left = road.height_m[0, middle] - wave[middle]
    assert np.abs(np.diff(left, 2)).max() < 1e-5
    assert np.ptp(left) < 0.2


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("station_m,height_m\n0,0\n1,0.1\n0.5,0\n", {}, "stations must increase"),
        ("station_m,height_m\n0,0\n1,0.1\n5,0\n6,0\n", {}, "no height over 4 m behind station 1 m"),
        ("station_m,height_m\n0,0\n1,10\n2,0\n", {}, "give heights in metres"),
        ("station_m,height_m\n0,0\n1,0.1\n2,0\n", {"length": 5.0}, "is 2 m long, and 5 m are asked for"),
        ("s,z\n0,0\n1,0.1\n", {}, "has no columns station_m and height_m"),
    ],
)
def test_a_file_that_is_no_road_is_refused(tmp_path, text, options, said):
    path = tmp_path / "lane.csv"
    path.write_text(text)
    with pytest.raises(DataRejectedError, match=said):
        requested_passes(CAMPAIGN, {"speeds": (80.0,), "road": str(path), **options})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"road": "B"}, "--road needs a --speed"),
        ({"speeds": (80.0,), "road": "J"}, "neither a class of ISO 8608"),
        ({"speeds": (80.0,), "road": "B", "bump": "one"}, "needs its station; add --at"),
        ({"speeds": (80.0,), "road": "B", "at": 10.0}, "name it by --bump FILE or --shape"),
        ({"speeds": (80.0,), "road": "B", "bump": "one", "at": 10.0}, "not a scan of the campaign"),
        ({"speeds": (80.0,), "road": "B", "hole": True}, "needs its station; add --at"),
        ({"speeds": (80.0,), "hole": True}, "--hole is cut into a road; add --road"),
        ({"speeds": (80.0,), "stress_exponent": 3.0}, "--stress-exponent is about the damage of a road; add --road"),
        ({"speeds": (80.0,), "road": "B:x"}, "write metres, as in B:200"),
        ({"speeds": (80.0,), "road": "B:100+A", "length": 50.0}, "give each class its own"),
        (
            {"speeds": (80.0,), "road": "B:20", "at": 19.0, "shape": "watts", "height": 0.1, "length": 3.0},
            "does not lie on a road of 20 m",
        ),
        ({"speeds": (80.0,), "road": "B", "lateral": 1.0}, "--lateral chooses"),
        ({"speeds": (80.0,), "realisations": 2}, "add --road"),
        ({"speeds": (80.0,), "shape": "watts", "height": 0.1, "length": 200.0}, "too long for a bump"),
    ],
)
def test_roads_that_cannot_be_driven_are_refused(options, said):
    with pytest.raises(CampaignError, match=said):
        requested_passes(CAMPAIGN, options)


def test_roads_follow_each_other_with_a_hole(tmp_path):
    path = tmp_path / "deck.csv"
    rows = [f"{0.5 * k},{0.001 * k},{0.003 * k}" for k in range(41)]
    path.write_text("\n".join(["station_m,left_height_m,right_height_m", *rows]))
    options = {"speeds": (80.0,), "road": f"C:30+{path}", "seed": 4, "at": 40.0, "hole": True}
    size = {"shape": "trapezoid", "height": 0.05, "length": 1.0, "top": 0.9}
    (found,) = requested_passes(CAMPAIGN, {**options, **size, "stress_exponent": 3.0})
    road = found.road
    assert (road.length_m, road.stress_exponent, road.obstacle_at_m, road.sunken) == (50.0, 3.0, 40.0, True)
    assert [part.length_m for part in road.parts] == [30.0, 20.0]
    assert road.parts[1].height_m.shape[0] == 2
    folder = tmp_path.name
    assert found.bump == (
        f"road class C, 30 m, seed 4 + {folder}/deck.csv, with hole of trapezoid 50 mm x 1 m, top 0.9 m at 40 m"
    )


def _river(folder) -> str:
    path = folder / "river.toml"
    path.write_text(
        "spans_m = [20.0]\nbending_stiffness_N_m2 = 2e10\nmass_kg_m = 9e3\ndamping_ratio = 0.01\n"
        'surface = { class = "A", seed = 2 }\n'
    )
    return str(path)


def test_a_bridge_from_a_file_with_its_own_or_another_surface(tmp_path):
    options = {"speeds": (36.0, 72.0), "bridge": _river(tmp_path)}
    own = requested_passes(CAMPAIGN, options)
    assert [r.bump for r in own] == ["bridge river, class A, seed 2"] * 2
    (found, _) = requested_passes(CAMPAIGN, {**options, "road": "c", "seed": 5, "realisations": 2, "vehicles": 3})
    assert found.bump == "bridge river, class C, seed 5 to 6, 3 vehicles 10 m apart"
    assert found.over_bump is False
    assert requested_passes(CAMPAIGN, {**options, "realisations": 5})[0].bump == "bridge river, class A, seed 2 to 6"
    assert own[0].bridge is not None
    named = replace(CAMPAIGN, bridges={"a1": own[0].bridge.bridge})
    assert requested_passes(named, {**options, "bridge": "a1"})[0].bridge.bridge is own[0].bridge.bridge


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"speeds": ()}, "--bridge needs a --speed"),
        ({"bridge": "b2"}, "neither a bridge of the campaign nor a file"),
        ({"height": 0.1}, "--bridge and --height are both given"),
        ({"road": "road.csv"}, "a measured surface stands in the bridge's table"),
        ({"bridge": "level.toml", "realisations": 3}, "add --road"),
        ({"gap": 5.0}, "add --vehicles"),
        ({"bridge": None, "vehicles": 2}, "add --bridge"),
    ],
)
def test_what_is_said_about_incomplete_bridges(tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    whole = {"speeds": (36.0,), "bridge": _river(tmp_path), **options}
    text = Path(_river(tmp_path)).read_text()
    Path("level.toml").write_text("".join(line for line in text.splitlines(True) if "surface" not in line))
    with pytest.raises(CampaignError, match=said):
        requested_passes(CAMPAIGN, whole)
