"""Scans and profiles whose headers promise more than there is, and clouds that no linear algebra survives."""

from __future__ import annotations

import struct
import sys
import time
from pathlib import Path

import laspy
import numpy as np
import pytest
from crg_files import crg_file
from memory_reader import taken
from plyfile import PlyData, PlyElement

from sysid import limits
from sysid.bounded_reader import read_in_child
from sysid.campaign.records import Scan
from sysid.errors import DataRejectedError
from sysid.road import analyse_scan, las_file, read_point_cloud
from sysid.road.cloud_libraries import read_las
from sysid.road.plane import NOISE_FLOOR_M, RoadPlane, refine_plane
from sysid.road.profile_files import bump_from_file

POINTS = np.round(np.random.default_rng(3).normal(size=(50, 3)), 3)
SCALE, OFFSET = np.array([1e-3, 1e-3, 1e-4]), np.array([4e5, 5e6, 100.0])


def las_bytes(folder: Path, point_format: int, version: str) -> bytes:
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.offsets, header.scales = OFFSET, SCALE
    header.vlrs.append(laspy.VLR("writer", 7, "further record", b"x" * 100))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (POINTS + OFFSET).T
    cloud.write(str(folder / "scan.las"))
    return (folder / "scan.las").read_bytes()


def refused(path: Path) -> str:
    with pytest.raises(DataRejectedError) as error:
        read_point_cloud(path)
    text = str(error.value)
    assert text.startswith(f"Scan {path.name}")
    assert "\n" not in text
    return text


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


FORMATS = [(0, "1.2"), (1, "1.2"), (2, "1.2"), (3, "1.2"), (4, "1.3"), (5, "1.3")]
FORMATS += [(k, "1.4") for k in range(11)]


@pytest.mark.parametrize(("point_format", "version"), FORMATS)
def test_every_point_format_reads_as_by_laspy(tmp_path: Path, point_format: int, version: str) -> None:
    las_bytes(tmp_path, point_format, version)
    with laspy.open(str(tmp_path / "scan.las")) as reader:
        cloud = reader.read()
    expected = np.column_stack([cloud.x, cloud.y, cloud.z])
    np.testing.assert_allclose(read_point_cloud(tmp_path / "scan.las"), expected, rtol=1e-15)
    np.testing.assert_allclose(expected - OFFSET, POINTS, atol=1e-6)


@pytest.mark.parametrize(
    ("at", "kind", "value", "said"),
    [
        (100, "<I", 4_000_000_000, "announces 4000000000 further records"),
        (107, "<I", 4_000_000_000, "4000000000 points, more than"),
        (96, "<I", 4_000_000_000, "outside the file"),
        (94, "<H", 65_535, "outside the file"),
        (105, "<H", 3, "format 3 with 3 bytes"),
        (104, "<B", 63, "format 63"),
        (107, "<I", 1000, "cut short"),
        (107, "<I", 0, "holds no points"),
        (131, "<d", np.nan, "no point with three numbers"),
        (131, "<d", 1e300, "no point with three numbers"),
        (155, "<d", np.inf, "no point with three numbers"),
    ],
)
def test_a_header_that_promises_too_much_is_refused_at_once(
    tmp_path: Path, at: int, kind: str, value, said: str
) -> None:
    raw = bytearray(las_bytes(tmp_path, 3, "1.2"))
    struct.pack_into(kind, raw, at, value)
    begin = time.process_time()
    assert said in refused(written(tmp_path / "bad.las", bytes(raw)))
    assert time.process_time() - begin < 1.0


def test_further_records_behind_the_points_are_bounded(tmp_path: Path) -> None:
    raw = bytearray(las_bytes(tmp_path, 6, "1.4"))
    struct.pack_into("<I", raw, 243, 4_000_000_000)
    assert "further records" in refused(written(tmp_path / "bad.las", bytes(raw)))


def test_a_compressed_file_goes_to_the_child_with_its_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = bytearray(las_bytes(tmp_path, 3, "1.2"))
    raw[104] |= 0x80
    seen = []

    def child(function, data, label, libraries, **request):
        seen.append((function, data == bytes(raw), libraries, request))
        return {}, [POINTS]

    monkeypatch.setattr(las_file, "read_in_child", child)
    np.testing.assert_array_equal(read_point_cloud(written(tmp_path / "scan.laz", bytes(raw))), POINTS)
    assert seen == [(read_las, True, ["laspy"], {"most_points": limits.CLOUD_POINTS})]


def ply(lines: str, body: str) -> bytes:
    return f"ply\nformat ascii 1.0\n{lines}end_header\n{body}".encode()


XYZ = "".join(f"property float {axis}\n" for axis in "xyz")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (ply("element vertex 3\n" + XYZ + "element face 1\nproperty list int int v\n",
             "1 2 3\n" * 2 + "2000000000 1\n"), "not every vertex has 3 numbers"),
        (ply("element vertex 900000\n" + XYZ + "".join(f"property double p{i}\n" for i in range(2000)),
             "1 2 3\n" * 200_000), "not every vertex has 2003 numbers"),
        # A row that holds more than the header names: which of its numbers is x?
        (ply("element vertex 2\n" + XYZ, "7 1 2 3\n" * 2), "not every vertex has 3 numbers"),
        (ply("element vertex 2\n" + XYZ, "1 2 3\n\n4 5 6\n"), "not every vertex has 3 numbers"),
        (ply("element vertex 2\n" + XYZ, "\n\n"), "not every vertex has 3 numbers"),
        (ply("element vertex 3\n" + XYZ, "1 2 3\n1 2 3\n"), "ends before its last vertex"),
        (ply("element vertex 1\n" + XYZ + "property list int int v\n", "1 2 3 0\n"), "have lists"),
        (ply("element face 1\nproperty list float int v\nelement vertex 1\n" + XYZ, "0\n1 2 3\n"), "the line"),
        # The first end_header stands in a comment.
        (ply("comment end_header\nelement vertex 99999999999999999\n" + XYZ, "1 2 3\n"), "announces"),
        (ply("element vertex 3\n" + XYZ + "property list float16 int v\n", "1 2 3\n"), "its header has the line"),
        (ply("element vertex 3\n" + XYZ.replace("float z", "float z\nproperty float z"), "1 2 3 4\n" * 3), "PLY"),
        (b"ply\nelement vertex 3\n" + XYZ.encode() + b"end_header\n1 2 3\n", "names no known format"),
    ],
)  # fmt: skip
def test_a_hostile_ply_file_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    assert said in refused(written(tmp_path / "bad.ply", content))


BINARY = "ply\nformat binary_little_endian 1.0\nelement face {}\nproperty list int int v\nelement vertex 2\n"


@pytest.mark.parametrize(
    ("faces", "lists", "said"),
    [
        (1, struct.pack("<i", 2_000_000_000), "ends before its last vertex"),
        (1, struct.pack("<i", -6), "a list without a length"),
        (9, struct.pack("<i", 5) + bytes(20), "a list without a length"),
    ],
)
def test_lists_that_lead_out_of_the_file(tmp_path: Path, faces: int, lists: bytes, said: str) -> None:
    vertices = struct.pack("<6f", *range(6))
    head = (BINARY.format(faces) + XYZ + "end_header\n").encode()
    assert said in refused(written(tmp_path / "bad.ply", head + lists + vertices))
    good = (BINARY.format(1) + XYZ + "end_header\n").encode() + struct.pack("<2i", 1, 7) + vertices
    np.testing.assert_array_equal(read_point_cloud(written(tmp_path / "good.ply", good)), [[0, 1, 2], [3, 4, 5]])


def test_leading_zeros_hide_no_count(tmp_path: Path) -> None:
    lines = "element vertex 3\n" + XYZ + f"element more {'0' * 30}99999999999\nproperty double a\n"
    assert "announces 100000000002" in refused(written(tmp_path / "bad.ply", ply(lines, "1 2 3\n" * 3)))


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_mesh_with_faces_reads_its_vertices(tmp_path: Path, text: bool, order: str) -> None:
    vertex = np.array([tuple(p) for p in POINTS], dtype=[(axis, "f8") for axis in "xyz"])
    face = np.array([([0, 1, 2],), ([2, 3, 4, 1],)], dtype=[("vertex_indices", object)])
    elements = [PlyElement.describe(face, "face"), PlyElement.describe(vertex, "vertex")]
    PlyData(elements, text=text, byte_order="=" if text else order).write(str(tmp_path / "mesh.ply"))
    np.testing.assert_allclose(read_point_cloud(tmp_path / "mesh.ply"), POINTS, rtol=1e-12)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits on memory are those of Linux")
def test_memory_of_the_child_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the full limit holds is refused under a smaller one."""
    # Far above what an allocator keeps of memory that was freed before: such memory is in use already, and no limit
    # counts it again.
    wanted = 300_000_000
    assert read_in_child(taken, b"", "scan.laz", ["numpy"], bytes=wanted)[0] == {"bytes": wanted}
    monkeypatch.setattr(limits, "READER_BYTES", 8_000_000)
    with pytest.raises(DataRejectedError, match="takes more than 8 MB of memory"):
        read_in_child(taken, b"", "scan.laz", ["numpy"], bytes=wanted)


def test_an_increment_that_asks_for_any_number_of_stations(tmp_path: Path) -> None:
    heights = 0.05 * np.sin(np.linspace(0.0, np.pi, 101))[:, None] * np.ones(3)
    sections = [f"long section at v = {v:.3f},m" for v in (-1.0, 0.0, 1.0)]
    good = crg_file(heights, sections, increment=0.05)
    assert bump_from_file(written(tmp_path / "good.crg", good)).heights_m
    for value in (b"1e-300", b"1e300", b"nan"):
        bad = good.replace(b"REFERENCE_LINE_INCREMENT = 0.05", b"REFERENCE_LINE_INCREMENT = " + value)
        assert bad != good
        with pytest.raises(DataRejectedError) as error:
            bump_from_file(written(tmp_path / "bad.crg", bad))
        assert "\n" not in str(error.value)
        assert "surface.crg" not in str(error.value)


def cloud(points: np.ndarray) -> str:
    with pytest.raises(DataRejectedError) as error:
        analyse_scan(Scan("bump", "cloud.csv", 0.0, points))
    assert str(error.value).startswith("Scan cloud.csv")
    return str(error.value)


def road(size: int = 3000) -> np.ndarray:
    """A lane of 6 m by 2 m with a smooth bump of 60 mm across it."""
    x, y = np.random.default_rng(5).random((2, size)) * [[6.0], [2.0]]
    return np.column_stack([x, y, 0.06 * np.exp(-(((x - 3.0) / 0.3) ** 2))])


@pytest.mark.parametrize("size", [1e20, 1e150, 1e300])
def test_coordinates_that_overflow_end_in_one_sentence(tmp_path: Path, size: float) -> None:
    assert "has 0 points" in cloud(road() * size)
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in road(300) * size)
    assert "no point with three numbers" in refused(written(tmp_path / "big.csv", f"x,y,z\n{rows}".encode()))


def test_strays_far_away_cost_nothing_and_change_nothing() -> None:
    points = road()
    strays = np.tile([[3e7, -2e7, 9e6]], (5, 1)) + np.arange(15.0).reshape(5, 3)
    clean = analyse_scan(Scan("bump", "cloud.csv", 0.0, points))
    found = analyse_scan(Scan("bump", "cloud.csv", 0.0, np.concatenate([points, strays, strays * 1e250])))
    np.testing.assert_array_equal(found.profile.height_m, clean.profile.height_m)


DEGENERATE = {
    "steps of a line": np.column_stack([np.arange(600) % 7, np.arange(600) % 7, 0.01 * (np.arange(600) % 13)]),
    "two places": np.tile([[0.0, 0.0, 0.0], [1.0, 1.0, 0.05]], (300, 1)) + 1e-9 * np.arange(600)[:, None],
    "grid of two lines": np.column_stack(
        [np.repeat([0.0, 1.0], 300), np.tile(np.arange(300) * 0.01, 2), np.zeros(600)]
    ),
    "steep wall": np.column_stack([1e-7 * np.arange(600), np.arange(600) * 0.01, np.arange(600) % 50 * 0.1]),
    "one plane of lattice": np.column_stack([np.arange(900) % 30, np.arange(900) // 30, np.zeros(900)]) * 0.1,
}


@pytest.mark.parametrize("points", DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_clouds_end_in_one_sentence(points: np.ndarray) -> None:
    assert "\n" not in cloud(points)


def test_a_road_on_one_line_keeps_the_plane_it_started_from() -> None:
    along = np.arange(100.0)
    start = RoadPlane(0.0, 0.0, 0.0, np.zeros((3, 3)))
    plane = refine_plane(np.column_stack([along, 0.0 * along, 0.0 * along]), NOISE_FLOOR_M, start)
    assert (plane.level_m, plane.slope_x, plane.slope_y) == (0.0, 0.0, 0.0)


def test_an_undetermined_fit_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    import sysid.road.scan as scan

    def singular(*arguments, **options):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(scan, "fit_strip", singular)
    assert "do not determine a road plane" in cloud(road())
