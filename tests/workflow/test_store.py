"""Stage results survive the way to disk and back; anything damaged or foreign is not believed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sysid.road.shapes import raised_cosine
from sysid.sdof.results import DropEstimate, DropSummary
from sysid.validation.results import ChannelAgreement, Validation
from sysid.workflow import store


def estimate(stiffness: float) -> DropEstimate:
    return DropEstimate(0, "unloaded", None, "paper", stiffness, 1.0, 2.0, float("nan"), 0.5, 0.3, True, "note")


def test_a_result_comes_back_as_it_was(tmp_path: Path) -> None:
    summary = DropSummary((), (estimate(4.2e5), estimate(1.0)), ("a message",))
    store.save(tmp_path / "drops.npz", summary, "print")
    found = store.load(tmp_path / "drops.npz", "print")
    assert isinstance(found, DropSummary)
    assert found.pooled[0].stiffness == 4.2e5
    assert np.isnan(found.pooled[0].damping_sd)
    assert found.messages == ("a message",)


def test_arrays_and_mappings_come_back_bit_by_bit(tmp_path: Path) -> None:
    profile = raised_cosine(0.08, 0.9)
    store.save(tmp_path / "x.npz", {"bump": profile, "none": None}, "print")
    found = store.load(tmp_path / "x.npz", "print")
    assert np.array_equal(found["bump"].height_m, profile.height_m)
    assert found["none"] is None


def test_other_inputs_damage_and_absence_give_none(tmp_path: Path) -> None:
    path = tmp_path / "v.npz"
    assert store.load(path, "print") is None
    store.save(path, Validation((ChannelAgreement("r", "c", "k", None, 0.1, 1.0, 5),)), "print")
    assert store.load(path, "print") is not None
    assert store.load(path, "other") is None
    content = bytearray(path.read_bytes())
    path.write_bytes(content[: len(content) // 2])
    assert store.load(path, "print") is None
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(bytes(content))
    found = store.load(path, "print")
    assert found is None or isinstance(found, Validation)


def test_a_file_cannot_name_a_class_of_its_choice(tmp_path: Path) -> None:
    path = tmp_path / "v.npz"
    tree = b'{"fingerprint": "print", "result": {"class": "Path", "members": {}}}'
    np.savez(path, tree=np.frombuffer(tree, dtype=np.uint8))
    assert store.load(path, "print") is None
