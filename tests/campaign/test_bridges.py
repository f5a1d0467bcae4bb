"""Bridges of a campaign file and of files of their own: what is read, and what is refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.bridge.description import made_bridge
from sysid.campaign.inputs.bridges import bridge_from_file
from sysid.errors import CampaignError, DataRejectedError
from sysid.road.profile_files import road_from_file

SPANS = """spans_m = [20.0, 25.0]
bending_stiffness_N_m2 = [2.5e10, 3e10]
mass_kg_m = 12000.0
damping_ratio = 0.015
"""
LINES = "station_m;moment_mid_m;shear_mid_1;stress_web\n0;0;0;0\n10;5;-0,5;1,5\n10;5;0,5;1,5\n20;0;0;0\n"
MODES = "station_m,mode1,mode2\n0,0,0\n5,0.7,1\n10,1,0\n15,0.7,-1\n20,0,0\n"


def read(folder: Path, text: str, **files: str):
    for name, content in files.items():
        (folder / f"{name}.csv").write_text(content, encoding="utf-8")
    path = folder / "river.toml"
    path.write_text(text, encoding="utf-8")
    return bridge_from_file(path, road_from_file)


def test_spans_and_supports(tmp_path: Path):
    found = read(tmp_path, SPANS + 'supports = ["fixed", "pinned", "pinned"]\nsurface = { class = "B", seed = 4 }\n')
    assert (found.name, found.span_m, found.mass_kg_m) == ("river", (20.0, 25.0), (12000.0, 12000.0))
    assert found.supports == ("fixed", "pinned", "pinned")
    assert found.surface is not None
    assert found.surface.label == "class B, seed 4"
    bridge = made_bridge(found)
    names = [line.name for line in bridge.lines]
    # Middles of spans and supports: no moment at a pinned end, shear on both sides of the inner support.
    assert names == [
        "moment at 0 m", "shear at 0 m",
        "moment at 10 m", "shear at 10 m", "deflection at 10 m",
        "moment at 20 m", "shear left of the support at 20 m", "shear right of the support at 20 m",
        "moment at 32.5 m", "shear at 32.5 m", "deflection at 32.5 m",
        "shear at 45 m",
    ]  # fmt: skip
    assert bridge.modes is not None
    assert bridge.modes.damping_ratio == pytest.approx(np.full(10, 0.015))


def test_influence_lines_and_modes_from_files(tmp_path: Path):
    text = """influence_lines = "lines.csv"
mode_shapes = "shapes.csv"
frequencies_hz = [4.0, 16.0]
modal_masses_kg = [9e4, 9e4]
damping_ratio = [0.01, 0.02]
mass_kg_m = 9000.0
"""
    found = read(tmp_path, text, lines=LINES, shapes=MODES)
    assert [(line.name, line.kind) for line in found.lines] == [
        ("moment mid", "moment"),
        ("shear mid", "shear"),
        ("stress_web", "other"),
    ]
    bridge = made_bridge(found)
    assert bridge.length_m == 20.0
    assert bridge.lines[1].jump_m == 10.0
    assert bridge.lines[1].curve.at(np.array([9.999, 10.001])) == pytest.approx([-0.5, 0.5], abs=1e-3)
    assert bridge.modes is not None
    assert bridge.modes.damping_ratio.tolist() == [0.01, 0.02]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("spans_m = [20.0]\nmass_kg_m = 1e4\ndamping_ratio = 0.01\n", "has no bending_stiffness_N_m2"),
        (SPANS.replace("damping_ratio = 0.015", ""), "has no damping_ratio"),
        (SPANS.replace("[2.5e10, 3e10]", "[2.5e10]"), "1 values of bending_stiffness_N_m2 for 2 spans"),
        (SPANS + 'supports = ["pinned", "pinned"]\n', "one support more than spans"),
        (SPANS + 'supports = ["pinned", "free", "pinned"]\n', "only an end can be free"),
        (SPANS + "sections_m = [46.0]\n", "section at 46 m on a length of 45 m"),
        (SPANS + 'influence_lines = "lines.csv"\n', "one or the other"),
        (SPANS + 'surface = { class = "B", bridge_at_m = 3.0 }\n', "belong to a file"),
        (SPANS + 'surface = { file = "lines.csv" }\n', "give bridge_at_m"),
        (SPANS + "spam = 1\n", "spam"),
        ('supports = ["pinned", "pinned"]\n', "give spans_m"),
        ("damping_ratio = 0.01\n", "neither spans_m nor influence_lines nor mode_shapes"),
        (
            'mode_shapes = "shapes.csv"\ndamping_ratio = 0.01\n',
            "bridge has mode_shapes; give as many frequencies_hz as modal_masses_kg",
        ),
        ('influence_lines = "missing.csv"\n', "does not exist"),
        ('influence_lines = "../lines.csv"\n', "leads outside"),
    ],
)
def test_wrong_tables_are_refused(tmp_path: Path, text: str, words: str):
    with pytest.raises(CampaignError, match=words) as refused:
        read(tmp_path, text, lines=LINES, shapes=MODES)
    assert str(refused.value).startswith("river.toml")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("station_m,moment_mid\n0,0\n1,1\n2,0\n", "end its name in the unit of the effect of 1 N: moment_NAME_m"),
        ("station_m,shear_mid_m\n0,0\n1,1\n2,0\n", "shear_NAME_1"),
        ("x,moment_mid_m\n0,0\n1,1\n2,0\n", "no column station_m"),
        ("station_m,moment_mid_m\n0,0\n2,1\n1,0\n", "stations must increase along the bridge .row 3"),
        ("station_m,moment_mid_m\n0,0\n1,\n2,0\n", "row 3: moment_mid_m is missing"),
        ("station_m,moment_mid_m\n0,0\n1,1e308\n2,0\n", "row 3: moment_mid_m is missing"),
        ("station_m\n0\n1\n2\n", "no influence lines beside station_m"),
        ("station_m,moment_mid_m\n-1,0\n1,1\n2,0\n", "count them from the first support"),
    ],
)
def test_wrong_influence_lines_are_refused(tmp_path: Path, lines: str, words: str):
    with pytest.raises(DataRejectedError, match=words):
        read(tmp_path, 'influence_lines = "lines.csv"\n', lines=lines)


def test_a_shape_for_every_frequency(tmp_path: Path):
    text = 'mode_shapes = "shapes.csv"\nfrequencies_hz = [4.0]\nmodal_masses_kg = [9e4]\ndamping_ratio = 0.01\n'
    with pytest.raises(DataRejectedError, match="2 columns of shapes"):
        read(tmp_path, text, shapes=MODES)


def test_a_surface_that_ends_before_the_bridge(tmp_path: Path):
    road = "station_m,height_m\n" + "\n".join(f"{0.1 * k:.1f},{0.001 * (k % 3)}" for k in range(101)) + "\n"
    good = SPANS + 'surface = { file = "road.csv", bridge_at_m = 4.0 }\n'
    found = read(tmp_path, good, road=road)
    assert found.surface is not None
    assert found.surface.bridge_at_m == 4.0
    with pytest.raises(DataRejectedError, match="lies behind its end"):
        read(tmp_path, good.replace("4.0", "40.0"), road=road)
