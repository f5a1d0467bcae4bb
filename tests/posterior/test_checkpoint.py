"""Chains that are stopped and continued: bit-identical, or refused with a reason."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from sysid.errors import CampaignError, DataRejectedError
from sysid.posterior.checkpoint import Checkpoint, Segment
from sysid.posterior.sampling import SamplingOptions, sample_posterior

NAMES = ("k_1", "k_2", "c_1")
CENTRE = np.array([12.0, 13.0, 9.0])
COVARIANCE = np.array([[0.04, 0.02, 0.0], [0.02, 0.09, 0.01], [0.0, 0.01, 0.01]])
PRECISION = np.linalg.inv(COVARIANCE)
#: Never converged, so that every run goes to its limit.
OPTIONS = SamplingOptions(ensembles=2, segment_steps=10, max_steps=60, min_effective=1e9, seed=5)


def density(points: np.ndarray) -> np.ndarray:
    centred = points - CENTRE
    return -0.5 * np.einsum("ni,ij,nj->n", centred, PRECISION, centred) + 0.1 * np.sin(centred[:, 0] * 9.0)


def sample(folder: Path | None, *, options: SamplingOptions = OPTIONS, resume: bool = False, **changes):
    arguments = {"centre": CENTRE, "covariance": COVARIANCE, "fingerprint": {"file runs/a.csv": "abc"}} | changes
    return sample_posterior(
        density,
        NAMES,
        arguments["centre"],
        arguments["covariance"],
        "test",
        options,
        folder=folder,
        fingerprint=arguments["fingerprint"],
        resume=resume,
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Path, object]:
    """An uninterrupted run and its folder."""
    folder = tmp_path_factory.mktemp("whole") / "chain"
    return folder, sample(folder)


def same(first, second) -> None:
    for field in dataclasses.fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, np.ndarray):
            assert a.tobytes() == b.tobytes(), field.name
        else:
            assert a == b, field.name


def test_keeping_the_chain_changes_nothing(whole):
    same(whole[1], sample(None))


@pytest.mark.parametrize("kept", range(6))
def test_a_run_stopped_after_any_segment_continues_bit_by_bit(whole, tmp_path, kept: int):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    for number in range(kept, 6):
        (folder / f"segment_{number:05d}.npz").unlink()
    (folder / "segment_00009.tmp").write_bytes(b"half a segment")
    same(whole[1], sample(folder, resume=True))
    assert len(list(folder.glob("segment_*.npz"))) == 6


def test_a_larger_limit_goes_on_where_the_chain_ended(whole, tmp_path):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    longer = dataclasses.replace(OPTIONS, max_steps=80)
    same(sample(folder, options=longer, resume=True), sample(None, options=longer))


def test_a_chain_that_has_converged_does_not_grow_when_resumed(tmp_path):
    folder = tmp_path / "chain"
    easy = dataclasses.replace(OPTIONS, max_steps=400, min_steps=40, min_effective=50.0, rhat_limit=1.5)
    first = sample(folder, options=easy)
    assert first.converged
    files = sorted(p.name for p in folder.iterdir())
    assert len(files) < 40
    same(first, sample(folder, options=easy, resume=True))
    assert sorted(p.name for p in folder.iterdir()) == files


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "not a zip", "encrypted"])
def test_a_damaged_last_segment_falls_back_on_the_one_before(whole, tmp_path, damage: str):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    last = folder / "segment_00005.npz"
    content = bytearray(last.read_bytes())
    if damage == "flipped":
        content[len(content) // 2] ^= 1
    elif damage == "encrypted":
        content[content.index(b"PK\x01\x02") + 8] ^= 1
    elif damage == "not a zip":
        content = bytearray(b"x" * 3000)
    else:
        content = content[: {"cut": len(content) // 2, "empty": 0}[damage]]
    last.write_bytes(bytes(content))
    same(whole[1], sample(folder, resume=True))


def test_no_flipped_bit_raises_or_changes_a_draw(tmp_path):
    """Five hundred flips over the whole file: each ends in the segment as written, or in none."""
    random = np.random.default_rng(2)
    segment = Segment(
        random.normal(size=(2, 2, 4, 3)),
        random.normal(size=(2, 2, 4)),
        np.ones((2, 4)),
        random.integers(0, 2**32, (2, 4), dtype=np.uint32),
        np.ones((2, 3)),
    )
    checkpoint = Checkpoint(tmp_path, {"a": "1"})
    checkpoint.open(resume=False)
    checkpoint.append(0, segment)
    path = tmp_path / "segment_00000.npz"
    content = path.read_bytes()
    for place in random.choice(len(content), 500):
        damaged = bytearray(content)
        damaged[place] ^= 1 << random.integers(8)
        path.write_bytes(bytes(damaged))
        for found in checkpoint.open(resume=True):
            for name, value in vars(segment).items():
                np.testing.assert_array_equal(getattr(found, name), value)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"options": dataclasses.replace(OPTIONS, seed=6)}, "setting seed"),
        ({"options": dataclasses.replace(OPTIONS, segment_steps=20)}, "setting segment_steps"),
        ({"fingerprint": {"file runs/a.csv": "changed"}}, "file runs/a.csv"),
        ({"fingerprint": {"file runs/a.csv": "abc", "file runs/b.csv": "new"}}, "file runs/b.csv"),
        ({"centre": CENTRE + 1e-12}, "least-squares optimum"),
        ({"covariance": COVARIANCE * 1.5}, "least-squares optimum"),
    ],
)
def test_changed_data_or_settings_are_refused_by_name(whole, tmp_path, change: dict, named: str):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    with pytest.raises(CampaignError, match=named):
        sample(folder, resume=True, **change)
    assert len(list(folder.glob("segment_*.npz"))) == 6


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b'"word"'])
def test_a_damaged_identity_is_refused_in_words(whole, tmp_path, content: bytes):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    (folder / "identity.json").write_bytes(content)
    with pytest.raises(CampaignError, match=r"identity\.json is damaged"):
        sample(folder, resume=True)
    assert len(list(folder.glob("segment_*.npz"))) == 6


def test_without_resume_an_old_chain_is_replaced(whole, tmp_path):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    short = dataclasses.replace(OPTIONS, seed=8, max_steps=20)
    same(sample(folder, options=short), sample(None, options=short))
    assert len(list(folder.glob("segment_*.npz"))) == 2


def test_a_folder_that_cannot_be_written_is_said_in_words(tmp_path):
    blocked = tmp_path / "chain"
    blocked.write_text("a file where the folder should be")
    with pytest.raises(DataRejectedError, match=r"chain/.*--output"):
        sample(blocked)


def test_no_finite_density_names_the_widest_parameter():
    with pytest.raises(DataRejectedError, match="k_2"):
        sample_posterior(lambda x: np.full(len(x), -np.inf), NAMES, CENTRE, COVARIANCE, "test", OPTIONS)


def test_walkers_avoid_a_region_without_density():
    found = sample_posterior(
        lambda x: np.where(x[:, 0] > CENTRE[0], density(x), -np.inf), NAMES, CENTRE, COVARIANCE, "test", OPTIONS
    )
    assert np.log(found.draws[..., 0]).min() > CENTRE[0]
    assert np.isfinite(found.log_probability).all()
