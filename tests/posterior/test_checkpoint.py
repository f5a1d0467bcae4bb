"""Chains that are stopped and continued: bit-identical, or refused with a reason."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from sysid.errors import CampaignError, DataRejectedError, OutputError
from sysid.posterior.checkpoint import Checkpoint
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior
from sysid.posterior.segments import read_segments, segment_file, segment_files

NAMES = ("k_1", "k_2", "c_1")
CENTRE = np.array([12.0, 13.0, 9.0])
COVARIANCE = np.array([[0.04, 0.02, 0.0], [0.02, 0.09, 0.01], [0.0, 0.01, 0.01]])
PRECISION = np.linalg.inv(COVARIANCE)
#: Never converged, so that every run goes to its limit.
OPTIONS = SamplingOptions(ensembles=2, segment_steps=10, max_steps=60, min_effective=1e9, seed=5)


def density(points: np.ndarray) -> np.ndarray:
    centred = points - CENTRE
    return -0.5 * np.einsum("ni,ij,nj->n", centred, PRECISION, centred) + 0.1 * np.sin(centred[:, 0] * 9.0)


def sample(folder: Path | None, *, options: SamplingOptions = OPTIONS, resume: bool = False, notice=None, **changes):
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
        notice=notice,
    )


def test_progress_speaks_at_every_step_between_the_stretches() -> None:
    seen: list[tuple[str, float]] = []

    def report(message: str, fraction: float) -> None:
        seen.append((message, fraction))

    sample_posterior(density, NAMES, CENTRE, COVARIANCE, "test", OPTIONS, progress=report)
    first = sorted(fraction for message, fraction in seen if message == "sampling, step 0")
    # Once at the beginning, then after every step of each of the two ensembles.
    assert len(first) == 1 + 2 * 10
    assert first[0] == 0.0
    assert first[-1] > 0.0
    assert np.diff(first) == pytest.approx(np.full(20, first[-1] / 20.0))


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


@pytest.mark.parametrize("kept", range(7))
def test_a_run_stopped_after_any_segment_continues_bit_by_bit(whole, tmp_path, kept: int):
    """Also beside what a killed process leaves: half a segment under another name."""
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    for path in segment_files(folder)[kept:]:
        path.unlink()
    (folder / ".writing-abc.npz").write_bytes(segment_file(whole[0], 0).read_bytes()[:3000])
    notes: list[str] = []
    same(whole[1], sample(folder, resume=True, notice=notes.append))
    assert notes == []
    assert contents(folder) == contents(whole[0])


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


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
    before = contents(folder)
    same(first, sample(folder, options=easy, resume=True))
    assert contents(folder) == before


def damaged(content: bytes, how: str) -> bytes:
    """Content as a failing disk leaves it."""
    if how == "flipped":
        place = len(content) // 2
        return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]
    return {"cut": content[: len(content) // 2], "empty": b"", "garbage": b"x" * 3000}[how]


@pytest.mark.parametrize("how", ["cut", "flipped", "empty", "garbage", "lost"])
@pytest.mark.parametrize("numbers", [[0], [3], [5], [2, 4], [0, 1, 2, 3, 4, 5]])
def test_damage_is_said_and_costs_no_draw(whole, tmp_path, numbers: list[int], how: str):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    for path in [segment_file(folder, number) for number in numbers]:
        if how == "lost":
            path.unlink()
        else:
            path.write_bytes(damaged(path.read_bytes(), how))
    notes: list[str] = []
    same(whole[1], sample(folder, resume=True, notice=notes.append))
    # A chain that ends earlier than it did is whole.
    silent = how == "lost" and numbers in ([5], [0, 1, 2, 3, 4, 5])
    assert [" is damaged: " in note for note in notes] == ([] if silent else [True])
    assert contents(folder) == contents(whole[0])
    again: list[str] = []
    same(whole[1], sample(folder, resume=True, notice=again.append))
    assert again == []


def test_a_damaged_segment_costs_itself_and_those_behind_it(whole, tmp_path):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    identity = stored_identity(folder)
    assert len(Checkpoint(folder, identity).open(resume=True).segments) == 6
    segment_file(folder, 4).write_bytes(b"x")
    assert len(Checkpoint(folder, identity).open(resume=True).segments) == 4


def test_a_segment_of_another_place_or_chain_is_no_continuation(whole, tmp_path):
    folder, other = tmp_path / "chain", tmp_path / "other"
    shutil.copytree(whole[0], folder)
    shutil.copyfile(segment_file(folder, 2), segment_file(folder, 4))
    assert len(read_segments(folder).segments) == 4
    sample(other, options=dataclasses.replace(OPTIONS, seed=9))
    shutil.copyfile(segment_file(other, 3), segment_file(folder, 3))
    assert len(read_segments(folder).segments) == 3


def test_no_flipped_bit_raises_or_changes_a_draw(whole, tmp_path):
    """A hundred flips over all files: what is found are the first segments as written, and how they end."""
    random = np.random.default_rng(2)
    folder = tmp_path / "chain"
    written = read_segments(whole[0]).segments
    identity = stored_identity(whole[0])
    for number in random.integers(6, size=100):
        shutil.copytree(whole[0], folder)
        flipped = bytearray(segment_file(folder, number).read_bytes())
        flipped[random.integers(len(flipped))] ^= 1 << random.integers(8)
        segment_file(folder, number).write_bytes(bytes(flipped))
        found = Checkpoint(folder, identity).open(resume=True)
        assert len(found.segments) == number
        for one, other in zip(found.segments, written, strict=False):
            equal(one, other)
        if found.segments:
            equal(found.ending, written[len(found.segments) - 1].ending)
        else:
            assert found.ending is None
        shutil.rmtree(folder)


def equal(first: object, second: object) -> None:
    for name, value in vars(second).items():
        np.testing.assert_array_equal(getattr(first, name), value)


def stored_identity(folder: Path) -> dict[str, str]:
    identity = read_segments(folder).identity
    assert identity is not None
    return identity


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
    # Also where the beginning of the other chain cannot be read.
    first = segment_file(folder, 0).read_bytes()
    segment_file(folder, 0).write_bytes(b"x")
    with pytest.raises(CampaignError, match=named):
        sample(folder, resume=True, **change)
    segment_file(folder, 0).write_bytes(first)
    same(whole[1], sample(folder, resume=True))


def test_without_resume_an_old_chain_is_replaced(whole, tmp_path):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    short = dataclasses.replace(OPTIONS, seed=8, max_steps=20)
    same(sample(folder, options=short), sample(None, options=short))
    same(sample(folder, options=short, resume=True), sample(None, options=short))


def test_a_folder_that_cannot_be_written_is_said_in_words(tmp_path):
    blocked = tmp_path / "chain"
    blocked.write_text("a file where the folder should be")
    with pytest.raises(OutputError, match=r"chain/.*--output"):
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
