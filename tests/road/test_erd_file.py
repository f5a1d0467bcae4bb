"""ERD files that the test writes itself, in the layout of LTPP's: tracks, units, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.errors import DataRejectedError
from sysid.road.profile_files import bump_from_file, road_from_file

STATION = 0.025 * np.arange(801)
LEFT, RIGHT = 4.0 * np.sin(STATION), 2.0 * np.cos(3.0 * STATION)


def erd(columns, *, names="LElev.  CElev.  RElev.  ", units="mm      mm      mm      ", step="0.0250", kind=5, more=""):
    rows = ["  ".join(f"{x:.4f}" for x in row) for row in np.array(columns).T]
    head = f" {len(columns):6d}, {len(rows):6d},     -1,      1, {kind:6d}, {step},     -1,"
    lines = ["ERDFILEV2.00", head, "TITLE   A section", f"SHORTNAM{names}", f"UNITSNAM{units}", "XUNITS  m", more]
    return "\n".join([*(line for line in lines if line), "END", *rows, ""])


def written(tmp_path, text, name="section.erd"):
    path = tmp_path / name
    path.write_text(text)
    return path


def without_line(height_mm):
    height = 1e-3 * height_mm
    return height - np.linspace(height[0], height[-1], height.size)


def test_both_tracks_of_a_road(tmp_path):
    path = written(tmp_path, erd([LEFT, 0.0 * LEFT, RIGHT]))
    road = road_from_file(path)
    assert road.length_m == pytest.approx(20.0)
    assert road.step_m == pytest.approx(0.025)
    np.testing.assert_allclose(road.height_m, [without_line(LEFT), without_line(RIGHT)], atol=2e-7)
    crossed = road_from_file(written(tmp_path, erd([LEFT, 0.0 * LEFT, RIGHT], names="RElev.  CElev.  LElev.  ")))
    np.testing.assert_allclose(crossed.height_m, road.height_m[::-1], atol=1e-12)


def test_feet_and_inches(tmp_path):
    text = erd([LEFT / 25.4], names="Elev.   ", units="in      ", step=f"{0.025 / 0.3048:.9f}")
    road = road_from_file(written(tmp_path, text.replace("XUNITS  m", "XUNITS  ft")))
    assert road.length_m == pytest.approx(20.0)
    np.testing.assert_allclose(road.height_m, [without_line(LEFT)], atol=2e-6)


def test_a_bump_is_the_mean_of_its_tracks(tmp_path):
    hump = 40.0 * np.maximum(np.sin(2.0 * np.pi * STATION / 40.0), 0.0)
    shape = bump_from_file(written(tmp_path, erd([hump, 0.5 * hump], names="LElev.  RElev.  ")))
    np.testing.assert_allclose(shape.heights_m, 0.75e-3 * hump, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (erd([LEFT], names="x       ", kind=1), r"binary numbers \(KEYNUM 1\)"),
        (erd([LEFT, RIGHT, LEFT], names="a       b       c       "), "which are the left and the right track"),
        (erd([LEFT], units=""), "UNITSNAM of channel 1 is missing"),
        (erd([LEFT], units="V       "), "is 'V'"),
        (erd([LEFT]).rsplit("\n", 5)[0], "801 samples"),
        (erd([LEFT], more="GAIN    2.0"), "GAIN in its header"),
        (erd([LEFT]).replace("END\n", "END\nx\n"), "is no number"),
        (erd([np.append(LEFT[:-1], 1e200)]), "sample 801 has a missing height"),
        ("ERDFILEV2.00\n1, 2\nEND\n0 0\n", "line 2 of an ERD file has seven numbers"),
        (erd([LEFT]).replace("END\n", ""), "no line END"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, text, said):
    with pytest.raises(DataRejectedError, match=said):
        road_from_file(written(tmp_path, text))


def test_ppf_files_are_refused(tmp_path):
    path = tmp_path / "lane.ppf"
    path.write_bytes(b"\x00\x01binary")
    with pytest.raises(DataRejectedError, match="save it from ProVAL as ERD"):
        road_from_file(path)


def test_columns_of_both_sides(tmp_path):
    rows = [f"{s:.4f},{a:.4f},{b:.4f}" for s, a, b in zip(STATION, LEFT, RIGHT, strict=True)]
    path = written(tmp_path, "\n".join(["station_m,left_height_mm,right_height_mm", *rows]), "sides.csv")
    np.testing.assert_allclose(road_from_file(path).height_m, [without_line(LEFT), without_line(RIGHT)], atol=2e-7)
    path.write_text("station_m,height_m,left_height_m,right_height_m\n0,0,0,0\n1,0,0,0\n2,0,0,0\n")
    with pytest.raises(DataRejectedError, match="heights of one track and of sides"):
        road_from_file(path)
    path.write_text("station_m,left_height_m\n0,0\n1,0\n2,0\n")
    with pytest.raises(DataRejectedError, match="no column height_m"):
        road_from_file(path)
