"""Stages are kept for the next, read back while their inputs stay the same, and forgotten when they change."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sysid.errors import CampaignError, DataRejectedError
from sysid.files import write_text
from sysid.progress import Progress
from sysid.results.contents import Results
from sysid.workflow import Calibration, Settings, make_settings
from sysid.workflow.earlier_files import remember_more
from sysid.workflow.stage import Ending
from sysid.workflow.stages import DROPS, PREDICT, SAMPLE
from sysid.workflow.stages.endings import EXPORT, REPORT

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
#: Drops by the single-axle equations alone: seconds instead of half a minute.
SINGLE_AXLE = Settings(drop_model=False)


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A copy of the linear truck with one drop per axle, quick to analyse."""
    folder = tmp_path / "campaign"
    shutil.copytree(DATA, folder)
    file = folder / "campaign.toml"
    lines = [line for line in file.read_text().splitlines() if "_drop2.csv" not in line and "_drop3.csv" not in line]
    file.write_text("\n".join(lines))
    return folder


def test_a_stage_is_read_back_by_the_next_process(campaign: Path, tmp_path: Path) -> None:
    first = Calibration(campaign, tmp_path / "out", SINGLE_AXLE)
    drops = first.drops()
    kept = (tmp_path / "out" / "stages" / "drops.npz").stat().st_mtime_ns
    second = Calibration(campaign, tmp_path / "out", SINGLE_AXLE)
    # What a record does not show is NaN, which equals nothing.
    assert repr(second.drops().pooled) == repr(drops.pooled)
    assert (tmp_path / "out" / "stages" / "drops.npz").stat().st_mtime_ns == kept


def test_a_changed_input_makes_a_stage_stale(campaign: Path, tmp_path: Path) -> None:
    before = Calibration(campaign, tmp_path / "out", SINGLE_AXLE).drops()
    file = campaign / "campaign.toml"
    file.write_text(file.read_text().replace("gravity_m_s2 = 9.81", "").replace(
        "tire_stiffness_N_per_m = 1650000", "tire_stiffness_N_per_m = 1500000"))  # fmt: skip
    after = Calibration(campaign, tmp_path / "out", SINGLE_AXLE).drops()
    assert after.pooled != before.pooled


def test_results_of_passes_that_are_gone_do_not_stay_in_the_folder(campaign: Path, tmp_path: Path) -> None:
    def ending(name: str) -> Ending:
        def write(results: Results, folder: Path, progress: Progress) -> Sequence[Path]:
            write_text(folder / "predictions" / name, "")
            return (folder / "predictions" / name,)

        return replace(EXPORT, write=write)

    calibration = Calibration(campaign, tmp_path / "out", SINGLE_AXLE)
    calibration.write(ending("empty_48kmh.csv"))
    calibration.write(ending("empty_50kmh.csv"))
    assert [p.name for p in (tmp_path / "out" / "predictions").iterdir()] == ["empty_50kmh.csv"]


def test_what_takes_long_to_write_says_how_far_it_is(campaign: Path, tmp_path: Path) -> None:
    def write(results: Results, folder: Path, progress: Progress) -> Sequence[Path]:
        progress("page", 0.5)
        return ()

    seen: list[tuple[str, float]] = []
    calibration = Calibration(campaign, tmp_path / "out", SINGLE_AXLE, lambda *said: seen.append(said))
    # An export comes after every stage: it says nothing.
    calibration.write(replace(EXPORT, write=write))
    assert seen == []
    calibration.write(replace(REPORT, write=write, helper=("json",)))
    assert seen == [("page", 0.5)]


def test_the_same_inputs_give_the_same_result_json_but_for_times(campaign: Path, tmp_path: Path) -> None:
    documents = []
    for name in ("a", "b"):
        calibration = Calibration(campaign, tmp_path / name, replace(make_settings(seed=5), drop_model=False))
        calibration.check()
        calibration.drops()
        calibration.export()
        document = json.loads((tmp_path / name / "result.json").read_text())
        document.pop("timings")
        assert document["identity"].pop("date")
        documents.append(json.dumps(document))
    assert documents[0] == documents[1]


def test_timings_count_each_stage_once(campaign: Path, tmp_path: Path) -> None:
    calibration = Calibration(campaign, tmp_path / "out", SINGLE_AXLE)
    calibration.drops()
    calibration.scan()
    timings = calibration.results().provenance["timings"]
    assert {"drops", "scan"} <= set(timings)
    assert all(seconds >= 0.0 for seconds in timings.values())


def test_an_output_folder_that_cannot_be_written_is_a_sentence(
    campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calibration = Calibration(campaign, tmp_path / "out", SINGLE_AXLE)

    def full(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sysid.workflow.store.save", full)
    with pytest.raises(DataRejectedError, match="No space left on device"):
        calibration.scan()


def test_a_campaign_without_bump_runs_cannot_be_fitted(campaign: Path, tmp_path: Path) -> None:
    file = campaign / "campaign.toml"
    lines = [line for line in file.read_text().splitlines() if 'file = "bump_runs/' not in line]
    file.write_text("\n".join(lines))
    with pytest.raises((DataRejectedError, CampaignError), match="bump"):
        Calibration(campaign, tmp_path / "out", SINGLE_AXLE).fit()


@pytest.mark.parametrize(("choice", "hint"), [({"laws": "Declared"}, "'declared'"), ({"contact": "cam"}, "'cams'")])
def test_choices_that_there_are_not_are_refused(choice: dict[str, str], hint: str) -> None:
    with pytest.raises(CampaignError, match=hint):
        make_settings(**choice)


def test_a_stage_computed_again_keeps_what_rests_on_it_if_it_comes_out_the_same(campaign: Path, tmp_path: Path) -> None:
    stages = tmp_path / "out" / "stages"
    Calibration(campaign, tmp_path / "out", SINGLE_AXLE).drops()
    fit, marker = stages / "fit.npz", tmp_path / "out" / "SUCCESS"
    for path in (fit, marker):
        path.write_text("of the same inputs\n")
    kept = (stages / "drops.npz").read_bytes()
    second = Calibration(campaign, tmp_path / "out", SINGLE_AXLE)
    second.again(DROPS)
    assert "drops" not in second.read_back
    assert (stages / "drops.npz").read_bytes() == kept
    assert fit.exists()
    assert marker.exists()
    (stages / "drops.npz").write_bytes(kept[:-1])
    Calibration(campaign, tmp_path / "out", SINGLE_AXLE).again(DROPS)
    assert (stages / "drops.npz").read_bytes() == kept
    assert not fit.exists()
    assert not marker.exists()


def test_what_was_written_stays_when_only_results_of_other_inputs_are_there(campaign: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    first = Calibration(campaign, output, SINGLE_AXLE)
    first.drops()
    first.export()
    kept = {path: path.read_bytes() for path in output.rglob("*") if path.is_file() and path.name != ".lock"}
    file = campaign / "campaign.toml"
    file.write_text(file.read_text() + "\n# A note.\n")
    second = Calibration(campaign, output, SINGLE_AXLE)
    for write in (second.export, second.report):
        with pytest.raises(CampaignError, match=r"results in out/ \(check, drops\) belong to other inputs"):
            write()
    assert {path: path.read_bytes() for path in kept} == kept
    # Whoever computes a stage wants its result, and what it does not concern any more goes.
    second.drops()
    second.export()
    # A damaged result is not one of other inputs.
    (output / "stages" / "drops.npz").write_bytes(b"damaged")
    Calibration(campaign, output, SINGLE_AXLE).export()


def test_a_run_from_the_beginning_removes_the_chain_of_the_one_before(campaign: Path, tmp_path: Path) -> None:
    """Else --resume would be refused after the fit: the chain belongs to other inputs."""
    output = tmp_path / "out"
    segment = output / "chain" / "segment-000000.npz"
    segment.parent.mkdir(parents=True)
    segment.write_bytes(b"of other inputs")
    notes = segment.with_name("notes.txt")
    notes.write_text("mine")
    settings = replace(SINGLE_AXLE, fit=replace(SINGLE_AXLE.fit, max_iterations=0))
    calibration = Calibration(campaign, output, settings, resume=True)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(calibration._runner), "result", _stopped)
        with pytest.raises(KeyboardInterrupt):
            calibration.run()
        assert segment.exists()
        with pytest.raises(KeyboardInterrupt):
            Calibration(campaign, output, settings).run()
    assert not segment.exists()
    assert notes.exists()


def _stopped(*_: object) -> None:
    raise KeyboardInterrupt


def test_passes_asked_for_by_options_go_with_the_results_that_they_rest_on(campaign: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    calibration = Calibration(campaign, output, SINGLE_AXLE)
    calibration.drops()
    path = output / "predictions" / "unloaded_60kmh.csv"
    write_text(path, "")
    remember_more(output, PREDICT.name, [path])
    calibration.again(DROPS)
    assert path.exists()
    (output / "stages" / "drops.npz").unlink()
    Calibration(campaign, output, SINGLE_AXLE).drops()
    assert not path.exists()


def test_a_posterior_is_stale_when_more_is_asked_of_it(campaign: Path, tmp_path: Path) -> None:
    def fingerprint(**changed: Any) -> str:
        settings = replace(SINGLE_AXLE, sampling=replace(SINGLE_AXLE.sampling, **changed))
        return Calibration(campaign, tmp_path / "out", settings)._folder.fingerprint(SAMPLE)

    assert fingerprint(max_steps=3000) == fingerprint()
    for changed in ({"min_effective": 2000.0}, {"rhat_limit": 1.001}, {"min_steps": 100}):
        assert fingerprint(**changed) != fingerprint()
