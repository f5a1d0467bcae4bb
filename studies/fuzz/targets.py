"""The readers that are fuzzed: real files as seeds, what is done with a damaged copy, and which code is watched.

What `sysid` reads in a child process is read in this process while it is fuzzed, because the fuzzer sees only the code
of its own process.  Whatever is found that way is then read once more as the product reads it.
"""

from __future__ import annotations

import hashlib
import io
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

SUPPORT = Path(__file__).resolve().parents[2] / "tests" / "support"
Read = Callable[[Path, bytes], Any]


@dataclass(frozen=True)
class Target:
    """One reader.

    `seeds` gives whole files by name.  `reader` imports what reads and gives a function (folder, content).  `watched`
    are the packages whose code guides the fuzzer beside `sysid`, `loaded` the modules that are imported for that
    before the first file.  `in_child`: the product reads such files in a child process.
    """

    name: str
    title: str
    seeds: Callable[[], dict[str, bytes]]
    reader: Callable[[], Read]
    watched: tuple[str, ...] = ()
    loaded: tuple[str, ...] = ()
    in_child: bool = False


def _support(module: str) -> Any:
    """A module of `tests/support`, whose modules import each other by their bare names."""
    import importlib

    if str(SUPPORT) not in sys.path:
        sys.path.append(str(SUPPORT))
    return importlib.import_module(module)


def _hostile_seeds(name: str) -> dict[str, bytes]:
    target = _support("hostile_files").targets()[name]
    return {f"{k:02d}": content for k, content in enumerate(target.seeds)}


def _hostile_reader(name: str) -> Read:
    read: Read = _support("hostile_files").targets()[name].read
    return read


def _clouds(mark: bytes) -> Callable[[], dict[str, bytes]]:
    return lambda: {n: c for n, c in _hostile_seeds("point cloud").items() if c.startswith(mark)}


def _log_seeds(*names: str) -> Callable[[], dict[str, bytes]]:
    return lambda: {name: getattr(_support("log_files"), name)() for name in names}


def _log_reader(suffix: str) -> Callable[[], Read]:
    def reader() -> Read:
        from sysid.campaign import Sensor, read_log

        sensors = (
            Sensor("q_mm", "suspension_deflection", "mm", axle=0, full_scale=0.15),
            Sensor("a_g", "axle_acceleration", "g", axle=0, full_scale=98.0),
        )

        def read(folder: Path, content: bytes) -> Any:
            path = folder / f"log{suffix}"
            path.write_bytes(content)
            return read_log(path, path.name, sensors, 0.005)

        return read

    return reader


#: Parts of a stage file in one content: fields first, then arrays.
_PART = b"\n--part--\n"


def _stage_seeds() -> dict[str, bytes]:
    from sysid.workflow import store

    made = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stage.npz"
        for number, (hint, result) in enumerate(_stage_results()):
            store.save(path, result, "f", hint)
            content = path.read_bytes()
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                parts = [archive.read(name) for name in archive.namelist()]
            fields = parts[0].split(b'"result": ', 1)[1][:-1]
            made[f"parts{number}"] = bytes([number]) + _PART.join([fields, *parts[1:]])
            made[f"whole{number}"] = bytes([128 + number]) + content[:-64]
    return made


@cache
def _stage_results() -> list[tuple[Any, Any]]:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.road.road_profile import ScanAnalysis
    from sysid.sdof.drop_results import DropSummary

    results = _support("small_results").small_results()
    return [
        (DropSummary, results.drops),
        (dict[str, ScanAnalysis], results.scans),
        (FitResult, results.fit),
        (Posterior, results.posterior),
    ]


def _stage_reader() -> Read:
    """The checksum of every content is made right: damage that it finds is told apart in the study of damages."""
    from sysid.workflow import store

    hints = [hint for hint, _ in _stage_results()]

    def read(folder: Path, content: bytes) -> Any:
        which, body = content[:1] or b"\0", content[1:]
        if which[0] < 128:
            fields, *arrays = body.split(_PART)
            stream = io.BytesIO()
            with zipfile.ZipFile(stream, "w") as archive:
                archive.writestr("fields.json", b'{"fingerprint": "f", "result": ' + fields + b"}")
                for number, array in enumerate(arrays):
                    archive.writestr(f"array_{number}.npy", array)
                archive.comment = b"0" * 64
            body = stream.getvalue()[:-64]
        path = folder / "stage.npz"
        path.write_bytes(body + hashlib.sha256(body).hexdigest().encode())
        return store.load(path, "f", hints[which[0] % 128 % len(hints)])

    return read


_FORMATS = "sysid.logs.formats"
TARGETS: dict[str, Target] = {
    t.name: t
    for t in (
        Target("campaign", "campaign file", lambda: _hostile_seeds("campaign"), lambda: _hostile_reader("campaign"),
               ("tomllib",)),
        Target("log", "text log", lambda: _hostile_seeds("log"), lambda: _hostile_reader("log")),
        Target("las", "LAS and LAZ", _clouds(b"LASF"), lambda: _hostile_reader("point cloud"), ("laspy",),
               ("laspy", "laspy.lib", "laspy.lasreader"), in_child=True),
        Target("ply", "PLY", _clouds(b"ply"), lambda: _hostile_reader("point cloud")),
        Target("crg", "OpenCRG", lambda: _hostile_seeds("OpenCRG"), lambda: _hostile_reader("OpenCRG"), ("pycrg",),
               ("pycrg",), in_child=True),
        Target("mdf", "MDF 3 and 4", _log_seeds("mdf4", "mdf3"), _log_reader(".mf4"), ("asammdf",),
               ("asammdf", f"{_FORMATS}.mdf"), in_child=True),
        Target("tdms", "TDMS", _log_seeds("tdms", "tdms_waveform"), _log_reader(".tdms"), ("nptdms",),
               ("nptdms", f"{_FORMATS}.tdms"), in_child=True),
        Target("mat", "MAT 4 to 7.3", _log_seeds("mat4", "mat5", "mat_structure", "mat73"), _log_reader(".mat"),
               ("scipy.io", "h5py"), ("scipy.io", "h5py", f"{_FORMATS}.mat"), in_child=True),
        Target("excel", "Excel", _log_seeds("xlsx"), _log_reader(".xlsx"), ("pandas",),
               ("python_calamine", "pandas", f"{_FORMATS}.excel"), in_child=True),
        Target("arrow", "Parquet and Feather", _log_seeds("parquet", "feather"), _log_reader(".parquet"), ("pyarrow",),
               ("pyarrow.parquet", "pyarrow.feather", f"{_FORMATS}.arrow"), in_child=True),
        Target("uff", "UFF 58", _log_seeds("uff58", "uff58b"), _log_reader(".uff"), ("pyuff",),
               ("pyuff", f"{_FORMATS}.uff"), in_child=True),
        Target("lvm", "LVM", _log_seeds("lvm"), _log_reader(".lvm"), ("lvm_read",), ("lvm_read", f"{_FORMATS}.lvm"),
               in_child=True),
        Target("stages", "stage file", _stage_seeds, _stage_reader),
    )
}  # fmt: skip
