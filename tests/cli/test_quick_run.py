"""The whole chain on two runs of the linear truck: every file of the output folder is there and says what it should."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from keyword_reader import read_deck

from studies.independent.normal_peaks import normal_peaks
from sysid.cli.stages import run_stage
from sysid.export import result_schema
from sysid.posterior import sampling as sampling_stage
from sysid.posterior.importance import ImportanceSample, importance_sample
from sysid.workflow.settings import make_settings

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
KEPT_RUNS = ("case3_unloaded_32kmh_run2", "case5_loaded_16kmh_run1")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Output folder of ``calibrate.py run --quick`` on a campaign with two runs and no prediction but one."""
    root = tmp_path_factory.mktemp("quick")
    folder = root / "campaign"
    shutil.copytree(DATA, folder)
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    lines = [
        line
        for line in text.splitlines()
        if 'file = "bump_runs/' not in line or any(name in line for name in KEPT_RUNS)
    ]
    (folder / "campaign.toml").write_text("\n".join(lines), encoding="utf-8")
    code = run_stage("run", folder, root / "out", quick=True, seed=3, max_steps=4, laws=None, resume=False)
    assert code == 0
    return root / "out"


def test_the_success_marker_says_preview(finished: Path) -> None:
    assert (finished / "SUCCESS").read_text(encoding="utf-8").strip() == "preview"


def test_result_json_follows_its_schema(finished: Path) -> None:
    document = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    jsonschema.validate(document, result_schema())
    assert document["status"] == "preview"
    assert document["seed"] == 3
    assert any("Preview" in warning for warning in document["warnings"])
    stiffness = {p["name"] for p in document["parameters"] if p["quantity"] == "stiffness"}
    assert {"k_1", "k_2[unloaded]", "k_2[loaded]", "k_6"} <= stiffness
    assert all(p["posterior"] is not None for p in document["parameters"] if p["quantity"] == "stiffness")


def test_predicted_passes_are_tables_on_a_millisecond_grid(finished: Path) -> None:
    document = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    assert len(document["predictions"]) == 12
    table = pd.read_csv(finished / document["predictions"][0]["file"])
    assert np.allclose(np.diff(table["time_s"]), 1e-3, atol=1e-9)
    assert table["time_s"].min() < -0.5
    assert {"tire_force1_N_q05", "tire_force6_N_q95"} <= set(table.columns)
    assert (table["tire_force1_N_q05"] <= table["tire_force1_N_q95"]).all()


def test_peaks_by_the_normal_at_the_optimum_are_those_of_the_same_passes(finished: Path) -> None:
    document = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    normal = normal_peaks(finished.parent / "campaign", finished, make_settings(quick=True, seed=3, max_steps=4))
    ratios = [p["peak_dynamic_load_ratio"] for p in document["predictions"]]
    sampled = np.array([[r[q] for q in ("q05", "q50", "q95")] for r in ratios]).reshape(2, 6, 3)
    half_width = 0.5 * (sampled[..., 2] - sampled[..., 0])
    assert np.all(np.abs(np.array(normal)[..., 1] - sampled[..., 1]) < 0.3 * half_width)
    np.testing.assert_allclose(np.array(normal)[..., 2] - np.array(normal)[..., 0], 2.0 * half_width, rtol=0.3)


def test_the_posterior_file_agrees_with_result_json(finished: Path) -> None:
    document = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    tree = xr.open_datatree(finished / "posterior.nc", engine="h5netcdf")
    posterior = tree["posterior"]
    for parameter in document["parameters"]:
        if parameter["name"] == "k_1":
            assert float(posterior["k_1"].mean()) == pytest.approx(parameter["posterior"]["mean"], rel=1e-9)
    tree.close()


def test_the_report_is_one_page_marked_as_preview(finished: Path) -> None:
    page = (finished / "report.html").read_text(encoding="utf-8")
    assert "preview" in page.lower()
    assert not re.search(r"""(src|href)=["']https?://""", page)


def test_the_report_draws_the_posterior_bands_of_driven_runs(finished: Path) -> None:
    page = (finished / "report.html").read_text(encoding="utf-8")
    # 18 channels per run.
    assert page.count('"band_low"') == 18 * len(KEPT_RUNS)
    assert "90 % new readings" in page


def test_a_report_without_options_shows_the_run_that_filled_the_folder(
    finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = finished.parent / "campaign"
    before = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    code = run_stage("report", campaign, finished, quick=False, seed=None, max_steps=None, laws=None, resume=False)
    assert code == 0
    assert "least squares" not in capsys.readouterr().err
    after = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    assert after["status"] == "preview"
    assert after["parameters"] == before["parameters"]


@pytest.fixture(scope="module")
def chained(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Output folder of the same campaign, its posterior from a chain of four steps: importance sampling does not do."""
    output = tmp_path_factory.mktemp("chained") / "out"
    shutil.copytree(finished, output)

    def unreliable(*args: object, **options: object) -> ImportanceSample:
        return replace(importance_sample(*args, **options), pareto_k=np.inf)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampling_stage, "importance_sample", unreliable)
        (output / "stages/sample.npz").unlink()
        choices = {"quick": True, "seed": 3, "max_steps": 4, "laws": None, "resume": False}
        assert run_stage("sample", finished.parent / "campaign", output, **choices) == 0
    assert (output / "chain").is_dir()
    return output


@pytest.fixture
def sampling(chained: Path, tmp_path: Path) -> Iterator[Path]:
    """Output folder in which another process is sampling: there is a chain, no result of it, and the lock is taken."""
    output = tmp_path / "out"
    shutil.copytree(chained, output)
    for name in ("stages/sample.npz", "stages/predict.npz", "posterior.nc", "report.html"):
        (output / name).unlink(missing_ok=True)
    code = (
        "import sys, time; from pathlib import Path; from sysid.folder_lock import FolderLock\n"
        "with FolderLock(Path(sys.argv[1])):\n    print('held', flush=True)\n    time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(output)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        yield output
        holder.kill()


@pytest.mark.parametrize(("stage", "file"), [("report", "report.html"), ("export", "posterior.nc")])
def test_a_running_chain_can_be_looked_at(finished: Path, chained: Path, sampling: Path, stage: str, file: str) -> None:
    campaign = finished.parent / "campaign"
    before = json.loads((chained / "result.json").read_text(encoding="utf-8"))
    code = run_stage(stage, campaign, sampling, quick=False, seed=None, max_steps=None, laws=None, resume=False)
    assert code == 0
    document = json.loads((sampling / "result.json").read_text(encoding="utf-8"))
    assert [p["posterior"] for p in document["parameters"]] == [p["posterior"] for p in before["parameters"]]
    assert any("Sampling has not finished" in warning for warning in document["warnings"])
    assert (sampling / file).is_file()


@pytest.mark.parametrize("stage", ["check", "sample", "run"])
def test_a_second_writer_is_refused_in_one_sentence(
    finished: Path, sampling: Path, stage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = {p: p.read_bytes() for p in sampling.rglob("*") if p.is_file()}
    code = run_stage(
        stage, finished.parent / "campaign", sampling, quick=True, seed=3, max_steps=4, laws=None, resume=False
    )
    assert code == 3
    assert "Another process is writing to out/" in capsys.readouterr().err
    assert {p: p.read_bytes() for p in sampling.rglob("*") if p.is_file()} == kept


def test_files_for_other_programs_hold_the_posterior_medians(finished: Path) -> None:
    document = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    median = {p["name"]: p["posterior"]["q50"] for p in document["parameters"] if p["posterior"]}
    for case in ("unloaded", "loaded"):
        deck = read_deck((finished / f"models/{case}/lsdyna.k").read_text(encoding="ascii"))
        assert any(f"load case {case}, posterior median" in line for line in deck.comments)
        for name, identifier in (("k_1", 9011), ("c_1", 9012), (f"k_2[{case}]", 9021), ("k_6", 9061), ("c_6", 9062)):
            assert float(deck.materials[identifier][1][0]) == pytest.approx(median[name], rel=1e-6)
        axle = json.loads((finished / f"models/{case}/chrono_suspension6.json").read_text(encoding="utf-8"))
        assert 2.0 * axle["Spring"]["Spring Coefficient"] == pytest.approx(median["k_6"], rel=1e-6)
        table = pd.read_csv(finished / f"models/{case}/vehicle.csv")
        assert set(table["source"]) == {"posterior median"}
    # The tire tangent of the first load case is the parameter itself.
    first = pd.read_csv(finished / "models/unloaded/vehicle.csv").query("kind == 'axle'")
    assert first["tire_stiffness_N_per_m"].iloc[5] == pytest.approx(median["kt_6"], rel=1e-6)
    assert len(list((finished / "moving_forces").iterdir())) == 2


def test_a_run_left_out_is_marked_in_table_and_report(finished: Path, tmp_path: Path, capsys) -> None:
    folder, copy = finished.parent / "campaign", tmp_path / "out"
    shutil.copytree(finished, copy)
    choices = {"quick": False, "seed": None, "max_steps": None, "laws": None, "resume": False}
    assert run_stage("validate", folder, copy, left_out=(KEPT_RUNS[0],), **choices) == 0
    assert "without it" in capsys.readouterr().out
    table = pd.read_csv(copy / "validation.csv")
    beyond = table[table["out_of_sample"]]
    assert set(beyond["run"]) == {f"bump_runs/{KEPT_RUNS[0]}.csv"}
    # One loaded run alone says little of the unloaded truck: worse than fitted, yet the same motion.
    fitted = table[~table["out_of_sample"] & (table["run"] == beyond["run"].iloc[0])]
    assert beyond["residual_over_noise"].median() > fitted["residual_over_noise"].median()
    assert beyond["nrmse"].median() < 0.03
    assert run_stage("report", folder, copy, **choices) == 0
    assert "has not seen them" in (copy / "report.html").read_text(encoding="utf-8")


def test_one_page_to_sign_takes_the_place_of_the_report(finished: Path) -> None:
    (finished / "report.html").rename(finished / "kept.html")
    code = run_stage("report", finished.parent / "campaign", finished, resume=False, summary=True)
    assert code == 0
    assert (finished / "summary.pdf").read_bytes().startswith(b"%PDF")
    assert not (finished / "report.html").exists()
    (finished / "kept.html").rename(finished / "report.html")


def test_covariance_belongs_to_the_result_beside_it(finished: Path) -> None:
    """As long as parameters, draws of importance sampling included; what `compare` reads has no negative direction."""
    covariance = json.loads((finished / "covariance.json").read_text(encoding="utf-8"))
    document = json.loads((finished / "result.json").read_text(encoding="utf-8"))
    assert covariance["identity"]["result_sha256"] == document["identity"]["content_sha256"]
    names = [p["name"] for p in document["parameters"] if p["run"] is None]
    assert [e["name"] for e in covariance["estimates"]] == names
    spread = np.array(covariance["covariance"])
    shared = np.array(covariance["sensitivity"])
    assert spread.shape == (len(names), len(names))
    assert shared.shape == (len(names), len(covariance["errors"]))
    assert np.linalg.eigvalsh(np.array(covariance["error_covariance"])).min() > 0.0
    assert {e["kind"] for e in covariance["errors"]} >= {"unsprung_mass_factor", "axle_load_scale_factor", "envelope"}
