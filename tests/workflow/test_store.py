"""Stage results survive the way to disk and back; anything damaged or foreign is not believed, and nothing raises."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import os
import threading
import tracemalloc
import zipfile
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from small_results import small_advice, small_balance, small_campaign, small_fit, small_profile, small_results

from sysid import array_file
from sysid.estimation.fit.state import FitPoint
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet, PriorLink
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.road.shapes import raised_cosine
from sysid.sdof.drop_results import DropEstimate, DropSummary
from sysid.validation.channel_agreement import ChannelAgreement, LeftOutRun, Validation
from sysid.vehicle_model.passes import MapTires
from sysid.workflow import Settings, recall, store
from sysid.workflow.schema import result_hint
from sysid.workflow.stage_folder import StageFolder
from sysid.workflow.stages import DROPS, STAGES
from sysid.workflow.stages.fit import KeptFit


def estimate(stiffness: float) -> DropEstimate:
    return DropEstimate(0, "unloaded", None, "paper", stiffness, 1.0, 2.0, float("nan"), 0.5, 0.3, True, "note")


SUMMARY = DropSummary((), (estimate(4.2e5), estimate(1.0)), ("a message",))


def small_kept_fit() -> KeptFit:
    count = len(small_fit().names)
    weights = Weights((np.ones((2, 3)),), (np.ones((2, 3)),), None)
    motion = RunMotion.steady(np.ones(2), np.zeros(2))
    parameters = ParameterSet((Parameter("k_1", "stiffness", "N/m", 1.0, 1.0, 0.1),), (PriorLink("a", "b", 0.0, 0.1),))
    point = FitPoint(
        parameters,
        "cams",
        MapTires((1.0, 2.0)),
        0.001,
        np.zeros(count),
        motion,
        weights,
        np.zeros(count),
        np.eye(count),
    )
    return KeptFit(small_fit(), point)


def every_result() -> dict[str, Any]:
    """A result of every stage by its name."""
    found = small_results()
    left = LeftOutRun("a", np.ones(3), np.zeros(3), True, 3.0, 0.1, found.validation.channels)
    return {
        "check": found.quality,
        "drops": found.drops,
        "balance": small_balance(),
        "scan": dict(found.scans),
        "fit": small_kept_fit(),
        "left_out": {"a": left},
        "validate": found.validation,
        "profile": {"k_1": small_profile()},
        "sample": found.posterior,
        "bands": tuple(h.band for h in found.fit.histories),
        "driven": found.driven,
        "predict": found.predictions,
        "advise": small_advice(small_fit()),
    }


def same(one: Any, other: Any) -> None:
    """Two results are equal to the last bit, and of the same types."""
    assert type(one) is type(other) or {type(one), type(other)} <= {tuple, list, float, np.float64, bool, np.bool_}
    if is_dataclass(one):
        for f in fields(one):
            same(getattr(one, f.name), getattr(other, f.name))
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            same(a, b)
    elif isinstance(one, dict):
        assert list(one) == list(other)
        for key in one:
            same(one[key], other[key])
    else:
        assert one == other or (one != one and other != other)


#: What follows from other results in seconds is in no file; the modes hold a vehicle, which no file holds.
KEPT = [stage for stage in STAGES if stage.name != "estimates"]


@pytest.mark.parametrize("stage", KEPT, ids=lambda s: s.name)
def test_the_result_of_every_stage_comes_back_as_it_was(tmp_path: Path, stage: Any) -> None:
    result = every_result()[stage.name]
    store.save(tmp_path / "x.npz", result, "print", result_hint(stage))
    same(result, store.load(tmp_path / "x.npz", "print", result_hint(stage)))


def test_arrays_come_back_bit_by_bit(tmp_path: Path) -> None:
    profile = raised_cosine(0.08, 0.9)
    odd = {
        "profile": replace(profile, height_m=np.asfortranarray(np.arange(6.0).reshape(2, 3))),
        "text": replace(profile, height_m=np.array(["a", "bc"])),
        "none": replace(profile, height_m=np.empty((0, 3)), station_m=np.array(3.0)),
        "special": replace(profile, height_m=np.array([np.nan, -0.0, np.inf])),
    }
    store.save(tmp_path / "x.npz", odd, "print", dict[str, type(profile)])
    found = store.load(tmp_path / "x.npz", "print", dict[str, type(profile)])
    same(odd, found)
    found["special"].height_m[0] = 1.0  # results of before could be written to as well
    # Anybody can look into a file.
    assert set(np.load(tmp_path / "x.npz").files) >= {"fields.json", "array_0"}


def test_other_inputs_and_absence_give_none(tmp_path: Path) -> None:
    path = tmp_path / "v.npz"
    assert store.load(path, "print", DropSummary) is None
    store.save(path, SUMMARY, "print", DropSummary)
    assert store.load(path, "print", DropSummary) is not None
    assert store.load(path, "other", DropSummary) is None
    assert store.load(path, "print", Validation) is None


def test_no_flipped_bit_raises_or_is_believed(tmp_path: Path) -> None:
    """400 flips over the files of all stages."""
    random = np.random.default_rng(400)
    path, results = tmp_path / "x.npz", every_result()
    for number in range(400):
        stage = KEPT[number % len(KEPT)]
        store.save(path, results[stage.name], "print", result_hint(stage))
        content = bytearray(path.read_bytes())
        content[random.integers(len(content))] ^= 1 << random.integers(8)
        path.write_bytes(bytes(content))
        assert store.load(path, "print", result_hint(stage)) is None


@pytest.mark.parametrize("content", [b"", b"x", b"x" * 64, b"PK" + b"\0" * 200, bytes(range(256)) * 20])
def test_other_files_are_not_there(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    assert store.load(path, "print", DropSummary) is None
    path.write_bytes(content + hashlib.sha256(content).hexdigest().encode())
    assert store.load(path, "print", DropSummary) is None


def test_a_cut_file_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    store.save(path, SUMMARY, "print", DropSummary)
    whole = path.read_bytes()
    for end in range(0, len(whole), 37):
        path.write_bytes(whole[:end])
        assert store.load(path, "print", DropSummary) is None


def forged(path: Path, tree: Any, entries: dict[str, bytes] | None = None, how: int = zipfile.ZIP_STORED) -> None:
    """A file with a right checksum that this package did not write."""
    text = tree if isinstance(tree, str) else json.dumps({"fingerprint": "print", "result": tree})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", how) as archive:
        archive.writestr("fields.json", text)
        for name, content in (entries or {}).items():
            archive.writestr(name, content)
        archive.comment = b"0" * 64
    content = buffer.getvalue()[:-64]
    path.write_bytes(content + hashlib.sha256(content).hexdigest().encode())


def stored_tree(path: Path, result: Any) -> Any:
    store.save(path, result, "print", type(result))
    content = array_file.read(path)
    assert content is not None
    return content.fields["result"]


@dataclass(frozen=True)
class Parts:
    """One member of every kind that a result has."""

    count: int
    sd: float
    good: bool
    kind: Literal["a", "b"]
    pair: tuple[int, str]
    many: tuple[float, ...]
    by_name: dict[str, float]
    values: np.ndarray
    perhaps: MapTires | None


PARTS = Parts(1, 2.0, True, "a", (1, "x"), (1.0, 2.0), {"a": 1.0}, np.ones(2), None)


@pytest.mark.parametrize(
    "members",
    [
        {"count": 1.5}, {"count": True}, {"count": "1"}, {"count": None}, {"sd": "2"}, {"sd": True}, {"sd": [2.0]},
        {"good": 1}, {"kind": "c"}, {"kind": 1}, {"pair": [1]}, {"pair": [1, "x", 2]}, {"pair": ["x", 1]},
        {"pair": {"items": []}}, {"many": 1.0}, {"many": ["x"]}, {"many": None}, {"by_name": {"a": 1.0}},
        {"by_name": {"items": [["a"]]}}, {"by_name": {"items": [["a", "b"]]}}, {"by_name": {"items": 3}},
        {"values": [1.0]}, {"values": {"array": "array_9"}}, {"values": {"array": ["array_0"]}},
        {"values": {"array": "array_0", "more": 1}}, {"perhaps": 1}, {"perhaps": {"class": "MapTires"}},
        {"perhaps": {"class": "Path", "members": {}}}, {"more": 1}, {"count": {"class": "int", "members": {}}},
    ],
)  # fmt: skip
def test_a_member_of_another_type_is_not_believed(tmp_path: Path, members: dict[str, Any]) -> None:
    path = tmp_path / "x.npz"
    tree = stored_tree(path, PARTS)
    values = {"array_0.npy": npy(np.ones(2))}
    forged(path, tree, values)
    same(store.load(path, "print", Parts), PARTS)
    tree["members"] |= members
    forged(path, tree, values)
    assert store.load(path, "print", Parts) is None


@pytest.mark.parametrize("tree", [1, None, [], "x", {}, {"class": "Path", "members": {}}, {"class": "Parts"}, [[[]]]])
def test_another_shape_of_tree_is_not_believed(tmp_path: Path, tree: Any) -> None:
    forged(tmp_path / "x.npz", tree)
    assert store.load(tmp_path / "x.npz", "print", Parts) is None


def npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def test_a_missing_member_is_not_filled_in(tmp_path: Path) -> None:
    tree = stored_tree(tmp_path / "x.npz", Validation((ChannelAgreement("r", "c", "k", None, 0.1, 1.0, 5),)))
    forged(tmp_path / "x.npz", tree)
    assert store.load(tmp_path / "x.npz", "print", Validation) is not None
    del tree["members"]["left_out"]
    forged(tmp_path / "x.npz", tree)
    assert store.load(tmp_path / "x.npz", "print", Validation) is None


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, '{"a":' * 100_000, "", "[]", "3", "\xff", '{"fingerprint": "print"}', '{"fingerprint": ["print"]}'],
)
def test_fields_that_are_none_are_not_there(tmp_path: Path, text: str) -> None:
    forged(tmp_path / "x.npz", text)
    assert store.load(tmp_path / "x.npz", "print", DropSummary) is None


def header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    ("entry", "how"),
    [
        (npy(np.zeros(25_000_000)), zipfile.ZIP_DEFLATED),
        (header("(1000000000000,)"), zipfile.ZIP_STORED),
        (header("(-1,)"), zipfile.ZIP_STORED),
        (header("(0, 1000000000000)") + b"1234", zipfile.ZIP_STORED),
        (header("(1000000000000,)", "<U0"), zipfile.ZIP_STORED),
        (header("(" * 5000), zipfile.ZIP_STORED),
        (npy(np.array([Path("x")], dtype=object)), zipfile.ZIP_STORED),
        (b"no array", zipfile.ZIP_STORED),
    ],
    ids=["bomb", "long", "negative", "empty", "texts of no length", "nested", "pickle", "none"],
)
def test_no_array_takes_more_memory_than_its_file(tmp_path: Path, entry: bytes, how: int) -> None:
    path = tmp_path / "x.npz"
    forged(path, {"array": "a"}, {"a.npy": entry}, how)
    tracemalloc.start()
    try:
        assert store.load(path, "print", np.ndarray) is None
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * path.stat().st_size + 4_000_000


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_in_place_of_a_file_keeps_nobody_waiting(tmp_path: Path) -> None:
    (tmp_path / "stages").mkdir()
    for name in ("timings.json", "settings.json", "drops.npz"):
        os.mkfifo(tmp_path / "stages" / name)
    seen: list[object] = []

    def look() -> None:
        folder = StageFolder(tmp_path, Settings(), small_campaign())
        seen.extend([folder.timings, folder.known(DROPS), recall(tmp_path)])

    reader = threading.Thread(target=look, daemon=True)
    reader.start()
    reader.join(30.0)
    assert seen == [{}, None, {}]


@pytest.mark.parametrize("content", ["", "[", "[" * 100_000, "3", '{"a": "x"}', '{"a": [1]}', '{"seed": -1}', "\0"])
def test_other_timings_and_settings_are_none(tmp_path: Path, content: str) -> None:
    (tmp_path / "stages").mkdir()
    for name in ("timings.json", "settings.json"):
        (tmp_path / "stages" / name).write_text(content)
    assert recall(tmp_path) == {}
    found = StageFolder(tmp_path, Settings(), small_campaign()).timings
    assert found == ({"seed": -1} if "seed" in content else {})


@pytest.mark.parametrize("other", [{"laws": "x"}, {"contact": "x"}, {"seed": -1}, {"seed": "0"}, {"quick": 1}])
def test_choices_that_nobody_could_have_typed_are_not_taken_over(tmp_path: Path, other: dict[str, Any]) -> None:
    (tmp_path / "stages").mkdir()
    kept = {"quick": True, "seed": 5, "laws": "declared", "contact": "cams", "contact_spread": False}
    (tmp_path / "stages" / "settings.json").write_text(json.dumps(kept))
    assert recall(tmp_path) == kept
    (tmp_path / "stages" / "settings.json").write_text(json.dumps(kept | other))
    assert recall(tmp_path) == {}


def test_a_result_that_nobody_would_read_back_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"(Posix|Windows)Path"):
        store.save(tmp_path / "x.npz", replace(SUMMARY, messages=(Path("x"),)), "print", DropSummary)
    with pytest.raises(TypeError, match=r"DropSummary.pooled: DropEstimate.axle: a int is expected"):
        store.save(tmp_path / "x.npz", DropSummary((), (replace(estimate(1.0), axle="1"),)), "print", DropSummary)
    assert not (tmp_path / "x.npz").exists()
    folder = StageFolder(tmp_path, Settings(), small_campaign())
    with pytest.warns(UserWarning, match="result of 'drops' is not kept: DropSummary.messages"):
        folder.keep(DROPS, replace(SUMMARY, messages=(1,)))
    assert folder.known(DROPS).messages == (1,)


def rewritten(path, change, compression=zipfile.ZIP_STORED):
    """The file as an archive of another program whose checksum is right."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        archive.writestr("fields.json", "{}")
        with archive.open("big.npy", "w") as entry:
            np.lib.format.write_array(entry, np.zeros(1_000_000), (1, 0))
        change(archive)
        archive.comment = b"0" * 64
    content = stream.getvalue()[:-64]
    path.write_bytes(content + hashlib.sha256(content).hexdigest().encode())
    return path


def same_bytes_under_many_names(archive):
    (big,) = (e for e in archive.filelist if e.filename == "big.npy")
    for number in range(500):
        again = copy.copy(big)
        again.filename = f"big{number}.npy"
        archive.filelist.append(again)


@pytest.mark.parametrize(
    ("change", "compression"),
    [(lambda archive: None, zipfile.ZIP_DEFLATED), (same_bytes_under_many_names, zipfile.ZIP_STORED)],
)
def test_a_file_that_expands_is_not_read(tmp_path, change, compression):
    assert array_file.read(rewritten(tmp_path / "good.npz", lambda archive: None)) is not None
    path = rewritten(tmp_path / "stage.npz", change, compression)
    tracemalloc.start()
    try:
        assert array_file.read(path) is None
        # Five hundred times 8 MB, or 8 MB from some kilobytes; the file itself is read.
        assert tracemalloc.get_traced_memory()[1] < 3 * path.stat().st_size + 1e6
    finally:
        tracemalloc.stop()


def test_a_file_longer_than_any_result_is_not_read_and_not_kept(tmp_path, monkeypatch):
    path = tmp_path / "stage.npz"
    array_file.write(path, {"a": 1}, {})
    with path.open("r+b") as stream:
        stream.truncate(3_000_000_000)  # no block of it is on the disk
    tracemalloc.start()
    try:
        assert array_file.read(path) is None
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()
    monkeypatch.setattr("sysid.limits.STAGE_BYTES", 1000)
    with pytest.raises(TypeError, match="more than"):
        store.save(path, SUMMARY, "fingerprint", result_hint(DROPS))
