"""Point-cloud files written by independent writers, faults one by one, and arbitrary bytes."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

import sysid.road.point_cloud as point_cloud
from sysid.errors import DataRejectedError
from sysid.road import read_point_cloud, read_point_cloud_counted

POINTS = np.round(np.random.default_rng(0).normal(size=(40, 3)), 4)
OFFSET = np.array([4e5, 5e6, 100.0])


def table(between: str = ",", decimal: str = ".", order: tuple[int, ...] = (0, 1, 2), extra: str = "", end: str = "\n"):
    rows = (between.join(f"{point[k]:.4f}".replace(".", decimal) for k in order) + extra for point in POINTS)
    return "".join(row + end for row in rows)


READABLE = {
    "plain": "x_m,y_m,z_m\n" + table(),
    "windows": "x,y,z\r\n" + table(end="\r\n"),
    "old mac": "x,y,z\r" + table(end="\r"),
    "bom": b"\xef\xbb\xbf" + ("x,y,z\n" + table()).encode(),
    "utf-16": ("x,y,z\n" + table()).encode("utf-16"),
    "latin-1 column": b"x,y,z,gr\xf6\xdfe\n" + table(extra=",1").encode(),
    "quoted header": '"X","Y","Z"\n' + table(),
    "units in brackets": "X [m],Y [m],Z [m]\n" + table(),
    "other order": "z_m,y_m,x_m\n" + table(order=(2, 1, 0)),
    "extra text": "x,y,z,label\n" + table(extra=",road surface"),
    "semicolon": "x;y;z\n" + table(";"),
    "semicolon and decimal comma": "x;y;z\n" + table(";", ","),
    "tab and decimal comma": "x\ty\tz\n" + table("\t", ","),
    "space and decimal comma": "x y z\n" + table(" ", ","),
    "comma and space": "x, y, z\n" + table(", "),
    "xyz": table("   "),
    "xyz with colour": table(" ", extra=" 10 20 30"),
    "pts": "40\n" + table(" ", extra=" 1 2 3 4"),
    "cloudcompare": "//X,Y,Z,Intensity\n" + table(extra=",1"),
    "comment": "# made by a scanner\n# x y z\n" + table(" "),
    "blank lines": "\n\nx,y,z\n\n" + table(end="\n\n"),
}
READABLE |= {
    "row of units": "x,y,z\nm,m,m\n" + table(),
    "units in brackets below": "X;Y;Z;Intensity\n[m];[m];[m];[-]\n" + table(";", ",", extra=";1"),
    "title": "Scan of the bump, 6 May\n\nx,y,z\n" + table(),
    "typographic minus": "x;y;z\n" + table(";").replace("-", "\u2212"),
}
READABLE["column in between"] = "x,intensity,y,z\n" + "".join(f"{x:.4f},7,{y:.4f},{z:.4f}\n" for x, y, z in POINTS)


def write(folder: Path, content: str | bytes, name: str = "scan.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("content", READABLE.values(), ids=READABLE.keys())
def test_text_layouts(tmp_path: Path, content: str | bytes) -> None:
    points, dropped = read_point_cloud_counted(write(tmp_path, content))
    np.testing.assert_allclose(points, POINTS, atol=1e-12)
    assert dropped == 0
    assert points.dtype == np.float64


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_ply(tmp_path: Path, text: bool, kind: str) -> None:
    vertex = np.zeros(40, dtype=[("nx", "f4"), ("x", kind), ("y", kind), ("z", kind), ("red", "u1")])
    for k, axis in enumerate("xyz"):
        vertex[axis] = POINTS[:, k]
    path = tmp_path / "scan.ply"
    PlyData([PlyElement.describe(vertex, "vertex")], text=text).write(str(path))
    np.testing.assert_allclose(read_point_cloud(path), POINTS, rtol=1e-6 if kind == "f4" else 1e-12, atol=1e-7)


def las_file(folder: Path) -> Path:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = OFFSET, np.full(3, 1e-4)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (POINTS + OFFSET).T
    cloud.write(str(folder / "scan.las"))
    return folder / "scan.las"


def test_las(tmp_path: Path) -> None:
    np.testing.assert_allclose(read_point_cloud(las_file(tmp_path)) - OFFSET, POINTS, atol=1e-8)


def las_with_keys(folder: Path, *records) -> Path:
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales = np.full(3, 1e-4)
    header.vlrs.extend(records)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS.T
    cloud.write(str(folder / "scan.las"))
    return folder / "scan.las"


def geo_keys(*pairs: tuple[int, int]) -> laspy.VLR:
    numbers = [1, 1, 0, len(pairs), *(n for key, value in pairs for n in (key, 0, 1, value))]
    return laspy.VLR("LASF_Projection", 34735, "keys", np.array(numbers, "<u2").tobytes())


WKT = 'PROJCS["x",GEOGCS["y",UNIT["degree",0.0174532925199433]],UNIT["US survey foot",0.304800609601219]]'


def test_the_unit_of_a_las_file_is_compared(tmp_path: Path) -> None:
    for records in ([], [geo_keys((3076, 9001), (4099, 9001))], [geo_keys((1024, 1))]):
        np.testing.assert_allclose(read_point_cloud(las_with_keys(tmp_path, *records)), POINTS, atol=1e-4)
    text = laspy.VLR("LASF_Projection", 2112, "wkt", WKT.encode() + b"\0")
    for records in ([geo_keys((3076, 9003))], [geo_keys((1024, 1), (4099, 9002))], [text]):
        path = las_with_keys(tmp_path, *records)
        with pytest.raises(DataRejectedError, match="coordinates are in ft, but the campaign file says unit = 'm'"):
            read_point_cloud(path)
        np.testing.assert_allclose(read_point_cloud(path, "ft"), 0.3048 * POINTS, atol=1e-4)


@pytest.mark.parametrize("comment", ["comment units: mm", "obj_info unit = millimetres", "comment unit mm"])
def test_the_unit_of_a_ply_file_is_compared(tmp_path: Path, comment: str) -> None:
    rows = b"".join(b"%f %f %f\n" % tuple(1e3 * p) for p in POINTS)
    path = write(tmp_path, (PLY_HEAD % (40, b"x")).replace(b"element", f"{comment}\nelement".encode(), 1) + rows)
    with pytest.raises(DataRejectedError, match="coordinates are in mm, but"):
        read_point_cloud(path)
    np.testing.assert_allclose(read_point_cloud(path, "mm"), POINTS, atol=1e-6)


def test_compressed_las_without_decompressor(tmp_path: Path) -> None:
    if laspy.LazBackend.detect_available():
        pytest.skip("a decompressor is installed")
    raw = bytearray(las_file(tmp_path).read_bytes())
    raw[104] |= 0x80  # the compression bit of the point format
    with pytest.raises(DataRejectedError, match="LAZ"):
        read_point_cloud(write(tmp_path, bytes(raw), "scan.laz"))


@pytest.mark.parametrize(
    ("unit", "factor"), [("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254), ("ft", 0.3048), ("dm", 0.1)]
)
def test_units(tmp_path: Path, unit: str, factor: float) -> None:
    points = read_point_cloud(write(tmp_path, f"x_{unit},y_{unit},z_{unit}\n" + table()), unit)
    np.testing.assert_allclose(points, POINTS * factor, rtol=1e-12)


HEADS_OF_UNITS = {
    "below": "x;y;z\nm;m;mm\n",
    "in the names": "x_m;y_m;z_mm\n",
    "for one axis": "x;y;z [mm]\n",
}


@pytest.mark.parametrize("head", HEADS_OF_UNITS.values(), ids=HEADS_OF_UNITS)
def test_every_axis_has_its_own_unit(tmp_path: Path, head: str) -> None:
    rows = "".join(f"{x:.4f};{y:.4f};{1e3 * z:.1f}\n" for x, y, z in POINTS)
    points = read_point_cloud(write(tmp_path, head + rows))
    np.testing.assert_allclose(points, POINTS, atol=1e-9)


@pytest.mark.parametrize("head", ["x;y;z\nmm;mm;mm\n", "x_mm;y_mm;z_mm\n", "x_m;y;z\nmm;m;m\n", "x;y;z\ns;m;m\n"])
def test_units_that_contradict_are_refused(tmp_path: Path, head: str) -> None:
    with pytest.raises(DataRejectedError, match=r"column 'x(_mm|_m)?' is in "):
        read_point_cloud(write(tmp_path, head + table(";")))


def test_incomplete_rows_are_dropped_and_counted(tmp_path: Path) -> None:
    content = "x,y,z\n" + table() + "1,,3\n1,nan,3\n,,\n1,2\n1,inf,3\n"
    points, dropped = read_point_cloud_counted(write(tmp_path, content))
    np.testing.assert_allclose(points, POINTS)
    assert dropped == 5


PLY_HEAD = (
    b"ply\nformat ascii 1.0\nelement vertex %d\nproperty float %s\nproperty float y\nproperty float z\nend_header\n"
)
FAULTS = {
    "empty": (b"", "is empty"),
    "header only": ("x,y,z\n", "no rows"),
    "garbage cell": ("x,y,z\n" + table() + "1,abc,3\n", "column y, data row 41: 'abc'"),
    "comma twice": ("x,y,z\n" + table(",", ","), "line 2: comma both between and inside"),
    "row too long": ("x,y,z\n" + table() + "1,2,3,4,5\n", "line 42: 5 columns where 3"),
    "header too short": ("x,y,z\n1,2,3,4,5\n", "line 2: 5 columns under a header of 3"),
    "duplicate header": ("x,y,z,x\n" + table(extra=",1"), "both name x"),
    "missing z": ("x,y,h\n" + table(), "no column z"),
    "no header names": ("a,b,c\n" + table(), "line 1: 'a,b,c'"),
    "unit in header": ("x_mm,y_mm,z_mm\n" + table(), "in mm but the campaign file says unit = 'm'"),
    "two columns": ("1 2\n3 4\n", "has 2 columns"),
    "mostly missing": ("x,y,z\n1,2,3\n" + ",,\n" * 9, "9 of 10 points"),
    "zero bytes": (b"x,y,z\n1,2,3\n\x00\x00", "zero bytes"),
    "web page": ("<html><body>404</body></html>", "neither numbers nor a header"),
    "one long line": ("1,2,3," * 30_000, "longer than"),
    "ten thousand columns": (",".join(["x", "y", "z", *(f"c{k}" for k in range(10_000))]) + "\n", "than 200 columns"),
    "bytes that are no text": (
        b"x,y,z,t\n" + table(extra=",1").encode() * 100 + b"1,2,3,\xff\xfe\n",
        "bytes that are not text",
    ),
    "open quote": ("x,y,z\n" + table() + '"1,2,3\n4,5,6\n', "table of numbers"),
    "ply cut in header": (b"ply\nformat ascii 1.0\n", "end of its header"),
    "ply bomb": (PLY_HEAD % (99_999_999_999_999, b"x"), "announces 99999999999999"),
    "ply without x": (PLY_HEAD % (1, b"a") + b"1 2 3\n", "no property x"),
    "ply cut short": (PLY_HEAD % (3, b"x") + b"1 2 3\n", "not a readable PLY"),
    "ply without points": (PLY_HEAD % (0, b"x"), "no points"),
    "las cut short": (b"LASF", "not a readable LAS"),
    "las of zeros": (b"LASF" + bytes(500), "not a readable LAS"),
}


@pytest.mark.parametrize(("content", "words"), FAULTS.values(), ids=FAULTS.keys())
def test_faults_end_in_one_sentence(tmp_path: Path, content: str | bytes, words: str) -> None:
    with pytest.raises(DataRejectedError) as caught:
        read_point_cloud(write(tmp_path, content))
    assert words in str(caught.value)
    assert str(caught.value).startswith("Scan scan.csv")
    assert "\n" not in str(caught.value)


def test_las_that_promises_more_points_than_it_has(tmp_path: Path) -> None:
    raw = las_file(tmp_path).read_bytes()
    with pytest.raises(DataRejectedError, match="cut short"):
        read_point_cloud(write(tmp_path, raw[:-200], "scan.las"))


def test_folder_missing_file_and_unknown_unit(tmp_path: Path) -> None:
    with pytest.raises(DataRejectedError, match="is a folder"):
        read_point_cloud(tmp_path)
    with pytest.raises(DataRejectedError, match="cannot be opened"):
        read_point_cloud(tmp_path / "nothing.csv")
    with pytest.raises(DataRejectedError, match="unit 'parsec'"):
        read_point_cloud(write(tmp_path, READABLE["plain"]), "parsec")


def test_size_limits_before_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "huge.csv"
    with path.open("wb") as stream:
        stream.truncate(2_000_000_000)  # sparse: takes no room on the disk
    with pytest.raises(DataRejectedError, match="2000 MB"):
        read_point_cloud(path)
    monkeypatch.setattr(point_cloud, "MAX_POINTS", 39)
    for file in (write(tmp_path, READABLE["plain"]), las_file(tmp_path)):
        with pytest.raises(DataRejectedError, match="points"):
            read_point_cloud(file)


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("seeds")
    vertex = np.array([tuple(p) for p in POINTS], dtype=[(axis, "f4") for axis in "xyz"])
    found = [READABLE["plain"].encode(), READABLE["tab and decimal comma"].encode(), las_file(folder).read_bytes()]
    for text in (False, True):
        PlyData([PlyElement.describe(vertex, "vertex")], text=text).write(str(folder / "scan.ply"))
        found.append((folder / "scan.ply").read_bytes())
    return found


def points_or_sentence(path: Path) -> np.ndarray | None:
    try:
        return read_point_cloud(path)
    except DataRejectedError as error:
        if path.name not in str(error) or "\n" in str(error):
            raise AssertionError(f"not a sentence that names the file: {error}") from error
        return None


@settings(
    max_examples=250, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    which=st.integers(0, 4),
    cut=st.one_of(st.none(), st.integers(0, 2000)),
    flips=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=6),
)
def test_damaged_files_never_end_in_a_traceback(tmp_path: Path, seeds, which: int, cut, flips) -> None:
    raw = bytearray(seeds[which][:cut])
    for position, value in flips:
        if raw:
            raw[position % len(raw)] = value
    path = write(tmp_path, bytes(raw), "damaged.bin")
    points = points_or_sentence(path)
    assert points is None or (points.shape[1] == 3 and np.all(np.isfinite(points)))


@settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.one_of(st.binary(max_size=300), st.text(alphabet='xyz_m0123456789.,;\t \n-+eE"#/', max_size=200)))
def test_arbitrary_bytes_never_end_in_a_traceback(tmp_path: Path, content) -> None:
    path = write(tmp_path, content, "noise.csv")
    points = points_or_sentence(path)
    assert points is None or points.shape[1] == 3
