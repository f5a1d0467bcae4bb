"""Damaged copies of real files, what reads them, and a watch over the time and memory that reading takes."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from crg_files import crg_file
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from studies.process import processor_seconds, reset_peak, status
from sysid.campaign import Sensor, check_quality, read_campaign, read_log
from sysid.campaign.records import Scan
from sysid.campaign.toml.reading import parse_toml, validate
from sysid.errors import SysidError
from sysid.road import analyse_scan, read_point_cloud
from sysid.road.profile_files import bump_from_file
from sysid.sdof import analyse_drop, read_decay

ROOT = Path(__file__).parents[2]
DATA, REAL = ROOT / "examples" / "linear_truck", ROOT / "tests" / "data"
RUN, DROP = "bump_runs/case2_unloaded_24kmh_run1.csv", "plank_drops/axle1_drop1.csv"


@dataclass(frozen=True)
class Target:
    """One reader: real files as seeds, and what is done with a damaged copy in a folder of its own."""

    name: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path, bytes], Any]


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _lines(path: Path, count: int) -> bytes:
    return b"\n".join(path.read_bytes().split(b"\n")[:count]) + b"\n"


def _small_campaign() -> str:
    """The linear truck with one drop and one run."""
    text = (DATA / "campaign.toml").read_text(encoding="utf-8")
    kept = []
    for line in text.split("\n"):
        named = re.search(r'file = "((?:plank_drops|bump_runs)/[^"]+)"', line)
        if named is None or named[1] in (RUN, DROP):
            kept.append(line)
    return "\n".join(kept)


def targets() -> dict[str, Target]:
    """Every reader of files from strangers."""
    drop = (DATA / DROP).read_bytes()
    run = _lines(DATA / RUN, 400)
    sensors = (
        Sensor("lvdt1_mm", "suspension_deflection", "mm", axle=0, full_scale=0.15),
        Sensor("axle1_accel_g", "axle_acceleration", "g", axle=0, full_scale=98.0),
        Sensor("frame_axle_mm", "suspension_deflection", "mm", axle=0, full_scale=0.15),
        Sensor("phi_rad", "suspension_deflection", "m", axle=0),
    )
    decays = tuple(_lines(REAL / "roll_decay" / name, 400) for name in ("roll_21337.csv", "roll_21340.csv"))
    german = drop.replace(b",", b";").replace(b".", b",")
    logs = (run, drop, german, drop.decode().encode("utf-16"), drop.replace(b"\n", b"\r\n"), *decays)
    campaign = _small_campaign().encode()

    def log(folder: Path, content: bytes) -> Any:
        return read_log(_written(folder / "log.csv", content), "log.csv", sensors, 0.005)

    def decay(folder: Path, content: bytes) -> Any:
        for channel in log(folder, content).channels:
            read_decay(channel.time_s, channel.value)

    def tests(folder: Path, content: bytes) -> Any:
        # The same damage to the log of the run and of the drop: one of them was made from its own kind.
        for name in (RUN, DROP):
            (folder / name).parent.mkdir(exist_ok=True)
            good = (DATA / name).read_bytes()
            _written(folder / name, content if content.split(b",", 2)[:2] == good.split(b",", 2)[:2] else good)
        _written(folder / "bump_scan.csv", b"x,y,z\n1,2,3\n")
        checked, _ = check_quality(read_campaign(_written(folder / "campaign.toml", campaign)))
        for plank in checked.plank_drops:
            analyse_drop(plank, checked.vehicle, checked.load_cases[plank.load_case])

    def whole(folder: Path, content: bytes) -> Any:
        for name in (RUN, DROP):
            (folder / name).parent.mkdir(exist_ok=True)
            _written(folder / name, _lines(DATA / name, 60))
        _written(folder / "bump_scan.csv", b"x,y,z\n1,2,3\n")
        return read_campaign(_written(folder / "campaign.toml", content))

    def scan(folder: Path, content: bytes) -> Any:
        points = read_point_cloud(_written(folder / "scan.bin", content))
        return analyse_scan(Scan("bump", "scan.bin", np.radians(4.3), points))

    clouds = _clouds()
    surface = 0.05 * np.sin(np.linspace(0.0, np.pi, 61))[:, None] * np.ones(3)
    sections = [f"long section at v = {v:.3f},m" for v in (-1.0, 0.0, 1.0)]
    crg = tuple(crg_file(surface, sections, increment=0.05, kind=kind) for kind in ("LRFI", "KDBI"))
    profile = (REAL / "road" / "bump_profile.csv").read_bytes().replace(b"s_m,z_m", b"station_m,height_m")
    return {
        t.name: t
        for t in (
            Target("campaign file", (campaign,), lambda folder, content: validate(parse_toml(content, "c"), "c")),
            Target("campaign", (campaign,), whole),
            Target("log", logs, log),
            Target("decay", decays, decay),
            Target("quality and drops", (run, drop), tests),
            Target("point cloud", clouds, lambda f, c: read_point_cloud(_written(f / "scan.bin", c))),
            Target("scan", clouds[:2], scan),
            Target("profile", (profile, profile.replace(b",", b"\t")), lambda f, c: bump_from_file(
                _written(f / "profile.csv", c))),
            Target("OpenCRG", crg, lambda f, c: bump_from_file(_written(f / "bump.crg", c))),
        )
    }  # fmt: skip


def _clouds() -> tuple[bytes, ...]:
    """The scan of the linear truck, thinned, as text, LAS of two versions, and PLY."""
    import tempfile

    text = b"\n".join((DATA / "bump_scan.csv").read_bytes().split(b"\n")[::12]) + b"\n"
    points = np.array([[float(c) for c in row.split(b",")[:3]] for row in text.split(b"\n")[1:-1]])
    found = [text, text.replace(b",", b"\t")]
    with tempfile.TemporaryDirectory() as folder:
        for point_format, version in ((3, "1.2"), (6, "1.4")):
            header = laspy.LasHeader(point_format=point_format, version=version)
            header.scales, header.offsets = np.full(3, 1e-4), points.mean(axis=0)
            cloud = laspy.LasData(header)
            cloud.x, cloud.y, cloud.z = points[:100].T
            cloud.write(f"{folder}/scan.las")
            found.append(Path(folder, "scan.las").read_bytes())
        compressed = bytearray(found[-1])
        compressed[104] |= 0x80
        found.append(bytes(compressed))
        vertex = np.array([tuple(p) for p in points[:100]], dtype=[(axis, "f8") for axis in "xyz"])
        face = np.array([([0, 1, 2],)], dtype=[("vertex_indices", "i4", (3,))])
        for elements, is_text in ((("v",), True), (("v",), False), (("v", "f"), False)):
            made = [PlyElement.describe(vertex, "vertex"), PlyElement.describe(face, "face")][: len(elements)]
            PlyData(made, text=is_text).write(f"{folder}/scan.ply")
            found.append(Path(folder, "scan.ply").read_bytes())
    return tuple(found)


#: What a stranger's file holds where a number, a name or a mark is expected.
TOKENS = [
    b"", b"nan", b"inf", b"-1", b"0", b"1e308", b"1e-308", b"1e400", b"-1e30", b"4294967295", b"99999999999999999999",
    b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n\n", b'"', b"'''", b'"""', b"#", b",", b";;;", b"\t", b"=", b"[[",
    b"]", b"{", b"}", b".", b"a.b.c.d.e.f.g.h.i = 1\n", b"../", b"/etc/passwd", b"\\", b"\x1b[31m", b"\xc3\x28",
    "\u202e".encode(), b"A" * 300, b"9" * 500, b"[" * 200, b"$", b"element vertex 999999999\n", b"end_header\n",
]  # fmt: skip

# Integers are spread more evenly than floats, which favour round values.
_POSITION = st.integers(0, 9_999).map(lambda k: k / 9_999)
_HEAD = st.integers(0, 299).map(lambda k: k / 9_999)
_DAMAGE = st.lists(
    st.one_of(
        st.tuples(st.just("cut"), _POSITION, st.just(0)),
        st.tuples(st.just("flip"), st.one_of(_HEAD, _POSITION), st.integers(0, 255)),
        st.tuples(st.just("bytes"), _HEAD, st.integers(0, 2**32 - 1)),
        st.tuples(st.just("delete"), st.one_of(_HEAD, _POSITION), st.integers(1, 2000)),
        st.tuples(st.just("insert"), st.one_of(_HEAD, _POSITION), st.integers(0, len(TOKENS) - 1)),
        st.tuples(st.just("number"), _POSITION, st.integers(0, len(TOKENS) - 1)),
        st.tuples(st.just("number"), _POSITION, st.integers(0, 10)),
        st.tuples(st.just("repeat"), _POSITION, st.integers(1, 300)),
        st.tuples(st.just("swap"), _POSITION, st.integers(1, 2000)),
    ),
    min_size=1,
    max_size=5,
)


def damages() -> st.SearchStrategy:
    """Up to six damages of a file, each (kind, place as a share of the file, number)."""
    return _DAMAGE


def damaged(seed: bytes, damage: list[tuple[str, float, int]]) -> bytes:
    """The file after all damages, 20 MB at most."""
    data = bytearray(seed)
    for kind, place, number in damage:
        at = int(place * max(len(data) - 1, 0))
        if kind == "cut":
            del data[at:]
        elif kind == "flip" and data:
            data[at] = number
        elif kind == "bytes":
            data[at : at + 4] = number.to_bytes(4, "little")
        elif kind == "delete":
            del data[at : at + number]
        elif kind == "insert":
            data[at:at] = TOKENS[number]
        elif kind == "number":
            found = re.compile(rb"[-+0-9.eE]+").search(data, at)
            if found:
                data[found.start() : found.end()] = TOKENS[number]
        elif kind == "repeat":
            piece = bytes(data[at : at + 200])
            data[at:at] = piece * number
        elif kind == "swap":
            data[at : at + 2 * number] = data[at + number : at + 2 * number] + data[at : at + number]
    return bytes(data[:20_000_000])


@dataclass
class Watch:
    """What reading took at most: processor seconds, and memory beyond that of the process before [bytes]."""

    examples: int = 0
    refused: int = 0
    seconds: float = 0.0
    bytes: float = 0.0

    @contextmanager
    def reading(self, hang_s: float = 30.0) -> Iterator[None]:
        """Measure one reading; a reader that takes so much processor time is interrupted and fails."""

        def interrupt(number: int, frame: object) -> None:
            raise AssertionError(f"reading took more than {hang_s:g} s")

        before = signal.signal(signal.SIGPROF, interrupt)
        signal.setitimer(signal.ITIMER_PROF, hang_s)
        resident = reset_peak()
        begin = processor_seconds()
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)
            self.examples += 1
            self.seconds = max(self.seconds, processor_seconds() - begin)
            self.bytes = max(self.bytes, status("VmHWM") - resident)


def check(target: Target, folder: Path, content: bytes, watch: Watch) -> None:
    """Read a damaged file: a result, or one sentence of at most 1000 characters; anything else is raised."""
    with watch.reading():
        try:
            target.read(folder, content)
        except SysidError as error:
            watch.refused += 1
            text = str(error)
            if "\n" in text or len(text) > 1000 or not text.endswith((".", "?")):
                raise AssertionError(f"not one sentence: {text[:1200]}") from error
