"""Bumps from files: OpenCRG surfaces that the test writes itself, columns of text, and files that hold no bump."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from crg_files import WIDTH, crg_file

from sysid.campaign.records import BumpShape
from sysid.errors import CampaignError, DataRejectedError
from sysid.road import named_shape
from sysid.road.profile_files import bump_from_file

STEP = 0.02
U = STEP * np.arange(251)
V = np.array([-1.5, -0.5, 0.0, 1.0])
HEIGHT, LENGTH = 0.08, 3.0
#: A sinusoidal hump that is lower towards the left, and flat on either side.
HUMP = np.where((U > 1.0) & (U < 4.0), 0.5 * HEIGHT * (1.0 - np.cos(2.0 * np.pi * (U - 1.0) / LENGTH)), 0.0)
SURFACE = HUMP[:, None] * (1.0 - 0.2 * V)
SECTIONS = [f"long section at v = {v:.3f},m" for v in V]


def written(tmp_path, content, name="hump.crg"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def heights(shape: BumpShape) -> np.ndarray:
    np.testing.assert_allclose(shape.station_m, U, atol=1e-9)
    return np.array(shape.heights_m)


@pytest.mark.parametrize("kind", list(WIDTH))
@pytest.mark.parametrize("lateral", [-1.5, 0.0, 0.5])
def test_every_format_gives_the_long_section(tmp_path, kind, lateral):
    path = written(tmp_path, crg_file(SURFACE, SECTIONS, increment=STEP, kind=kind))
    shape = bump_from_file(path, lateral)
    np.testing.assert_allclose(heights(shape), HUMP * (1.0 - 0.2 * lateral), atol=2e-6)
    assert shape.label == f"hump.crg, v = {lateral:g} m"


def test_a_sinusoidal_hump_is_the_one_by_name_and_size(tmp_path):
    path = written(tmp_path, crg_file(SURFACE, SECTIONS, increment=STEP, kind="KDBI"))
    found, expected = named_shape(bump_from_file(path)), named_shape(BumpShape("sinusoidal", HEIGHT, LENGTH))
    assert found.length_m == pytest.approx(expected.length_m, abs=2.0 * STEP)
    middle = found.start_m + 0.5 * found.length_m
    offset = np.linspace(-1.8, 1.8, 300)
    height = np.interp(middle + offset, found.station_m, found.height_m)
    exact = np.where(np.abs(offset) < 1.5, 0.5 * HEIGHT * (1.0 + np.cos(2.0 * np.pi * offset / LENGTH)), 0.0)
    # Straight lines between stations: h'' du^2 / 8, and the middle is known to half a step of the resampled profile.
    slope, curvature = np.pi * HEIGHT / LENGTH, 2.0 * np.pi**2 * HEIGHT / LENGTH**2
    assert np.abs(height - exact).max() < curvature * STEP**2 / 8.0 + slope * 0.002


def test_slope_banking_and_start_of_the_road_leave_the_bump_as_it_is(tmp_path):
    # z = grid + integrated slope + v times banking; the road begins at u = 100 m.
    count = U.size
    rows = np.column_stack([np.full(count, 0.03), np.full(count, 0.02), SURFACE])
    names = ["reference line slope,m/m", "reference line banking,m/m", *SECTIONS]
    road = ["REFERENCE_LINE_START_U = 100.0", f"REFERENCE_LINE_END_U = {100.0 + U[-1]}"]
    path = written(tmp_path, crg_file(rows, names, increment=STEP, road=road, kind="LDFI"))
    np.testing.assert_allclose(heights(bump_from_file(path, 1.0)), HUMP * 0.8, atol=2e-6)


def test_a_curved_road_is_followed_along_its_reference_line(tmp_path):
    rows = np.column_stack([np.linspace(0.0, 0.5, U.size), SURFACE])
    path = written(tmp_path, crg_file(rows, ["reference line phi,rad", *SECTIONS], increment=STEP))
    np.testing.assert_allclose(heights(bump_from_file(path)), HUMP, atol=2e-6)


def test_numbered_sections_and_modifiers(tmp_path):
    road = ["LONG_SECTION_V_RIGHT = -1.0", "LONG_SECTION_V_LEFT = 1.0", "LONG_SECTION_V_INCREMENT = 1.0"]
    grid = HUMP[:, None] * np.array([1.0, 2.0, 3.0])
    names = [f"long section {i},m" for i in (1, 2, 3)]
    mods = ["$ROAD_CRG_MODS", "SCALE_Z_GRID = 0.5", "$"]
    path = written(tmp_path, crg_file(grid, names, increment=STEP, road=road, sections=mods))
    np.testing.assert_allclose(heights(bump_from_file(path, 0.5)), 0.5 * 2.5 * HUMP, atol=2e-6)


def test_columns_of_text(tmp_path):
    lines = ["station_m;height_m", *(f"{u:.3f};{z:.6f}" for u, z in zip(U, HUMP, strict=True))]
    shape = bump_from_file(written(tmp_path, "\n".join(lines).replace(".", ",").encode(), "hump.csv"))
    np.testing.assert_allclose(heights(shape), HUMP, atol=1e-6)
    assert shape.label == "hump.csv"


@pytest.mark.parametrize(
    ("head", "metres"),
    [("station_m;height_mm\n", (1.0, 1e-3)), ("station;height\nm;mm\n", (1.0, 1e-3)),
     ("Station [m];Height [in]\n", (1.0, 0.0254)), ("bump 3\nstation_mm;height_m\n[mm];[m]\n", (1e-3, 1.0))],
)  # fmt: skip
def test_columns_of_text_in_their_units(tmp_path, head, metres):
    rows = "".join(f"{u / metres[0]:.6f};{z / metres[1]:.6f}\n" for u, z in zip(U, HUMP, strict=True))
    np.testing.assert_allclose(
        heights(bump_from_file(written(tmp_path, (head + rows).encode(), "hump.csv"))), HUMP, atol=1e-6
    )


@pytest.mark.parametrize(
    ("head", "said"),
    [("station;height\n", "has no unit"), ("station_m;height_m\nm;mm\n", "is in m and mm"),
     ("station_m;height_g\n", "is in g"), ("station_m;height_m;height_mm\n", "several columns of height")],
)  # fmt: skip
def test_columns_of_text_without_a_clear_unit(tmp_path, head, said):
    rows = "".join(
        f"{u:.3f};{z:.6f}{';0' * (head.count(';') > 1 and 'several' in said)}\n" for u, z in zip(U, HUMP, strict=True)
    )
    with pytest.raises(DataRejectedError, match=said):
        bump_from_file(written(tmp_path, (head + rows).encode(), "hump.csv"))


# ---------------------------------------------------------------------- holes and units of surfaces


def with_hole(columns: slice) -> np.ndarray:
    surface = SURFACE.copy()
    surface[100:110, columns] = np.nan
    return surface


@pytest.mark.parametrize("kind", list(WIDTH))
@pytest.mark.parametrize("mode", [None, "GRID_NAN_MODE = 0", "GRID_NAN_MODE = 1", "GRID_NAN_MODE = 2"])
def test_a_hole_is_never_filled_from_the_column_beside_it(tmp_path, kind, mode):
    """Whatever the modifiers of the file, the library fills the crest with the height of another column, or zero."""
    mods = [] if mode is None else ["$ROAD_CRG_MODS", mode, "$"]
    path = written(tmp_path, crg_file(with_hole(slice(2, 4)), SECTIONS, increment=STEP, kind=kind, sections=mods))
    for lateral in (0.0, 0.5, 1.0, -0.2):
        with pytest.raises(
            DataRejectedError, match=rf"no height everywhere along v = {lateral:g} m \(10 cross sections"
        ):
            bump_from_file(path, lateral)
    # Beside the hole the surface is whole.
    np.testing.assert_allclose(heights(bump_from_file(path, -0.5)), HUMP * 1.1, atol=2e-6)


def test_long_sections_in_another_unit(tmp_path):
    names = [name.replace(",m", ",mm") for name in SECTIONS]
    path = written(tmp_path, crg_file(1e3 * SURFACE, names, increment=STEP, kind="LDFI"))
    np.testing.assert_allclose(heights(bump_from_file(path)), HUMP, atol=2e-6)
    turned = np.column_stack([np.linspace(0.0, 5.0, U.size), SURFACE])
    for channels, said in (
        (["reference line phi,deg", *SECTIONS], "'reference line phi' in deg"),
        ([SECTIONS[0].replace(",m", ",in"), *SECTIONS[1:]], "long sections in in and m"),
        ([name.replace(",m", ",kg") for name in SECTIONS], "OpenCRG"),
    ):
        rows = turned if len(channels) > len(SECTIONS) else SURFACE
        with pytest.raises(DataRejectedError, match=said):
            bump_from_file(written(tmp_path, crg_file(rows, channels, increment=STEP)))


GOOD = crg_file(SURFACE, SECTIONS, increment=STEP)


@pytest.mark.parametrize(
    ("content", "name", "said"),
    [
        (b"", "a.crg", "cannot be read as OpenCRG"),
        (bytes(range(256)) * 40, "a.crg", "cannot be read as OpenCRG"),
        (GOOD[: GOOD.index(b"$$$$")], "a.crg", "cannot be read as OpenCRG"),
        (GOOD.replace(b"REFERENCE_LINE_INCREMENT = 0.02", b"REFERENCE_LINE_INCREMENT = -1"), "a.crg", "no height"),
        (GOOD.replace(b"REFERENCE_LINE_INCREMENT = 0.02", b"REFERENCE_LINE_INCREMENT = 1e-9"), "a.crg", "a.crg"),
        (GOOD.replace(b"#:LRFI", b"#:XXXX"), "a.crg", "OpenCRG"),
        (
            GOOD.replace(b"$KD_DEF", b"$ROAD_CRG_FILE\n/etc/passwd\n$\n$KD_DEF"),
            "a.crg",
            "refers to another",
        ),
        (crg_file(0.0 * SURFACE, SECTIONS, increment=STEP), "a.crg", "rises by 0 m at most"),
        (crg_file(-SURFACE, SECTIONS, increment=STEP), "a.crg", "at most"),
        (crg_file(30.0 * SURFACE, SECTIONS, increment=STEP), "a.crg", "rises by 2.4 m at most"),
        (crg_file(SURFACE, SECTIONS, increment=2.0), "a.crg", "more than the 100000 and 100 m"),
        (b"", "a.csv", "is empty"),
        (b"x,y\n1,2\n2,3\n", "a.csv", "no columns station_m and height_m"),
        (b"station_m,height_m\n0,0\n1,\n2,0\n", "a.csv", "row 3: height_m is missing"),
        (b"station_m,height_m\n0,0\n1,0.1\n2,0.1\n", "a.csv", "must lie on the road"),
        (b"station_m,height_m\n0,0\n2,0.1\n1,0.0\n", "a.csv", "do not increase"),
        (b"station_m,height_m\n0,0\n1,<script>\n2,0\n", "a.csv", "a.csv"),
    ],
)
def test_what_is_no_bump_is_one_sentence(tmp_path, content, name, said):
    with pytest.raises(DataRejectedError) as caught:
        bump_from_file(written(tmp_path, content, name))
    text = str(caught.value)
    assert said in text
    assert "\n" not in text
    assert text.endswith(".")
    assert str(tmp_path) not in text


def test_a_section_beside_the_road_is_refused(tmp_path):
    path = written(tmp_path, GOOD)
    with pytest.raises(DataRejectedError, match=r"from v = -1.5 to 1 m, and v = 2 m lies outside"):
        bump_from_file(path, 2.0)
    assert bump_from_file(path, 1.0).heights_m


def test_a_folder_and_a_file_that_is_not_there(tmp_path):
    for path in (tmp_path, tmp_path / "none.crg"):
        with pytest.raises(DataRejectedError, match="not a plain file"):
            bump_from_file(path)


def test_cut_and_changed_files_never_show_a_traceback(tmp_path):
    random = np.random.default_rng(6)
    section = b"D:long section at v = 1e30,m\n"
    pieces = (b"1e308", b"-1", b"999999999", b"NaN", b"\0", b"$", section, b"*missing*", b"A" * 300)
    read, refused = 0, []
    for _ in range(40):
        content = bytearray(GOOD)
        for _ in range(random.integers(1, 5)):
            at = int(random.integers(len(content) if random.random() < 0.3 else 600))
            way = random.integers(4)
            if way == 0:
                content[at] = random.integers(256)
            elif way == 1:
                del content[at : at + int(random.integers(1, 60))]
            elif way == 2:
                content[at:at] = pieces[random.integers(len(pieces))]
            else:
                content = content[: max(at, 700)]
        try:
            bump_from_file(written(tmp_path, bytes(content)))
            read += 1
        except DataRejectedError as error:
            refused.append(str(error))
    assert read > 5
    assert len(refused) > 5
    assert not any("\n" in text for text in refused)


def test_without_the_package_a_sentence_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycrg", None)
    with pytest.raises(CampaignError, match="pip install pycrg"):
        bump_from_file(written(tmp_path, GOOD))
