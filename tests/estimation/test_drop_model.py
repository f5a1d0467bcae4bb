"""Plank drops fitted by the full model, against the linear truck's truth (made by another engine)."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from sysid.campaign import Channel, Log, PlankDrop, Sensor, check_quality, read_campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit import drop_model
from sysid.estimation.fit.drop_model import fit_drops, with_model_estimates
from sysid.estimation.fit.options import FitOptions
from sysid.road import read_point_cloud
from sysid.sdof.summary import analyse_drops

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
FILES = ("axle1_drop2.csv", "axle3_drop3.csv", "axle5_drop1.csv")
OPTIONS = FitOptions(weight_rounds=1, tolerance=1e-4)


@pytest.fixture(scope="module")
def campaign():
    whole, _ = check_quality(read_campaign(DATA, point_cloud_reader=read_point_cloud))
    return replace(whole, plank_drops=tuple(d for d in whole.plank_drops if d.log.file.endswith(FILES)))


@pytest.fixture(scope="module")
def analysed(campaign):
    return analyse_drops(campaign)


@pytest.fixture(scope="module")
def found(campaign, analysed):
    return {e.axle: e for e in fit_drops(campaign, analysed, OPTIONS)}


def errors(estimates) -> dict[int, tuple[float, float]]:
    """Relative errors of k and c by axle."""
    axles = tomllib.loads((DATA / "truth.toml").read_text(encoding="utf-8"))["axle"]
    return {
        e.axle: (
            e.stiffness / axles[e.axle]["suspension_stiffness_N_per_m"] - 1.0,
            e.damping / axles[e.axle]["suspension_damping_N_s_per_m"] - 1.0,
        )
        for e in estimates
    }


def test_one_drop_per_axle_is_enough_for_stiffness_and_damping(found):
    assert sorted(found) == [0, 2, 4]
    # The search has converged by its own, coarse tolerance: the values become priors of the bump runs.
    assert all(e.usable for e in found.values())
    for k, c in errors(found.values()).values():
        assert abs(k) < 0.05
        assert abs(c) < 0.12


def test_closer_to_the_truth_than_the_paper(found, analysed):
    """Median over the axles, for stiffness and for damping."""
    paper = errors(e for e in analysed.pooled if e.method == "paper")
    for part in (0, 1):
        ours = np.median([abs(e[part]) for e in errors(found.values()).values()])
        assert ours < 0.5 * np.median([abs(e[part]) for e in paper.values()])


def test_estimates_stand_beside_the_single_axle_ones(campaign, analysed, found, monkeypatch):
    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", lambda *arguments: tuple(found.values()))
    summary = with_model_estimates(campaign, analysed, OPTIONS)
    assert [e.method for e in summary.pooled if e.axle == 2] == ["model", "paper", "corrected", "free_decay"]


def test_drops_without_dampers_are_not_fitted(campaign, analysed):
    bare = replace(campaign, plank_drops=tuple(replace(d, dampers=False) for d in campaign.plank_drops))
    with pytest.raises(DataRejectedError, match="dampers"):
        fit_drops(bare, analysed, OPTIONS)
    assert "dampers" in with_model_estimates(bare, analysed, OPTIONS).messages[-1]


@pytest.mark.parametrize(
    "failure",
    [np.linalg.LinAlgError("SVD did not converge"), FloatingPointError("overflow"), RuntimeError("nonfinite solve")],
)
def test_a_fit_that_breaks_down_costs_its_estimates_only(campaign, analysed, monkeypatch, failure):
    def broken(*arguments):
        raise failure

    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", broken)
    summary = with_model_estimates(campaign, analysed, OPTIONS)
    assert summary.pooled == analysed.pooled
    assert summary.files is analysed.files
    assert summary.messages[: len(analysed.messages)] == analysed.messages
    assert str(failure) in summary.messages[-1]


def test_numbers_that_are_not_finite_are_no_estimates(campaign, analysed, found, monkeypatch):
    bad = replace(found[0], stiffness=float("nan"))
    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", lambda *arguments: (bad, found[2]))
    summary = with_model_estimates(campaign, analysed, OPTIONS)
    assert [e.axle for e in summary.pooled if e.method == "model"] == [2]
    assert "no finite numbers" in summary.messages[-1]


def test_bodies_that_are_let_go_are_not_fitted(campaign, analysed):
    bodies = tuple(replace(d, release="body", plank_height_m=None) for d in campaign.plank_drops)
    summary = with_model_estimates(replace(campaign, plank_drops=bodies), analysed, OPTIONS)
    assert summary.pooled == analysed.pooled
    assert "let go" in summary.messages[-1]


@pytest.mark.parametrize(
    ("misfit", "converged", "little"), [(1.5, True, False), (1.7, True, True), (1.7, False, False), (3.3, False, True)]
)
def test_the_search_of_drops_ends_early_only_where_linear_laws_do_not_suit(misfit, converged, little):
    """A search that has not ended may still come below what is doubtful: it goes on."""
    optimum = SimpleNamespace(misfit=misfit, minimum=SimpleNamespace(converged=converged))
    assert drop_model._says_little(optimum) is little


class _SeenError(Exception):
    """Carries the drops as runs to the test."""


def fitted_runs(campaign, analysed, monkeypatch):
    """The drops as runs, as the fit begins with them."""

    def seen(as_runs, drops):
        raise _SeenError(as_runs.bump_runs)

    monkeypatch.setattr("sysid.estimation.fit.drop_model.campaign_parameters", seen)
    with pytest.raises(_SeenError) as caught:
        fit_drops(campaign, analysed, OPTIONS)
    return caught.value.args[0]


def as_recorded(drop):
    return drop


def with_offset_and_hole(drop):
    """Readings far from zero, one of them missing while the wheel still stands on the plank."""
    channels = []
    for channel in drop.log.channels:
        value = channel.value + (0.3 if channel.sensor.kind == "suspension_deflection" else 0.0)
        value[10] = np.nan
        channels.append(replace(channel, value=value))
    return replace(drop, log=replace(drop.log, channels=tuple(channels)))


def beside_another_axle(drop):
    """The deflection of another axle, which moves early, stands first in the log."""
    own = next(c for c in drop.log.channels if c.sensor.kind == "suspension_deflection")
    sensor = replace(own.sensor, column="other_mm", axle=(drop.axle + 1) % 6)
    other = replace(own, sensor=sensor, value=0.02 * np.exp(-(((own.time_s - 0.1) / 0.05) ** 2)))
    return replace(drop, log=replace(drop.log, channels=(other, *drop.log.channels)))


@pytest.mark.parametrize(
    "altered",
    [
        as_recorded,
        pytest.param(with_offset_and_hole, marks=pytest.mark.long),
        pytest.param(beside_another_axle, marks=pytest.mark.long),
    ],
)
def test_three_seconds_after_the_release_are_fitted(altered, monkeypatch):
    """Also where the rest on the plank is the largest departure from the median, as on 12 of these drops."""
    whole, _ = check_quality(read_campaign(DATA))
    campaign = replace(whole, plank_drops=tuple(altered(d) for d in whole.plank_drops))
    drops = analyse_drops(campaign)
    runs = fitted_runs(campaign, drops, monkeypatch)
    assert len(runs) == 18
    for run, analysis in zip(runs, drops.files, strict=True):
        for channel in run.log.channels:
            assert channel.time_s[-1] - drop_model.LEAD_S - analysis.release_time_s == pytest.approx(3.0, abs=0.006)


def test_a_second_drop_of_a_file_is_not_fitted(campaign, analysed, monkeypatch):
    again = tuple(replace(a, second_drop_s=a.release_time_s + 1.4) for a in analysed.files)
    for run, analysis in zip(
        fitted_runs(campaign, replace(analysed, files=again), monkeypatch), analysed.files, strict=True
    ):
        end = run.log.channels[0].time_s[-1] - drop_model.LEAD_S
        assert end == pytest.approx(analysis.release_time_s + 1.4, abs=0.006)


def test_a_drop_without_a_release_is_not_fitted(campaign, analysed, monkeypatch):
    files = (replace(analysed.files[0], release_time_s=float("nan")), *analysed.files[1:])
    assert len(fitted_runs(campaign, replace(analysed, files=files), monkeypatch)) == len(files) - 1


def noise_found(noise, rate_hz):
    """Noise that the fit takes for a drop at 1 s which leaves a slow swing of 2 mm."""
    time = np.arange(noise.size) / rate_hz
    u = np.maximum(time - 1.0, 0.0)
    motion = 0.04 * np.exp(-1.5 * u) * np.cos(10.0 * u) + 0.002 * np.sin(9.0 * time)
    sensor = Sensor("frame_axle_mm", "suspension_deflection", "mm", axle=0)
    channel = Channel(sensor, time, motion + noise, np.zeros(time.size, np.int8))
    drop = PlankDrop(0, "unloaded", 0.075, Log("drops/one.csv", 1.0 / rate_hz, (channel,)))
    return drop_model._noise(drop, 1.0)["frame_axle_mm of axle 1"]


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
@pytest.mark.parametrize("cutoff_hz", [50.0, 80.0])
def test_noise_behind_the_filter_of_a_logger_is_seen(rate_hz, cutoff_hz):
    """Butterworth noise of known standard deviation; its fourth differences show 0.3 to 67 % of it."""
    white = 5e-4 * np.random.default_rng(2).standard_normal(int(6.0 * rate_hz))
    noise = sosfilt(butter(4, cutoff_hz, output="sos", fs=rate_hz), white)
    assert 0.65 * noise.std() < noise_found(noise, rate_hz) < 1.15 * noise.std()


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_white_noise_is_found_as_it_is(rate_hz):
    noise = 3e-4 * np.random.default_rng(3).standard_normal(int(6.0 * rate_hz))
    assert noise_found(noise, rate_hz) == pytest.approx(noise.std(), rel=0.1)


def test_a_channel_that_begins_after_the_fitted_part_is_left_out(campaign, analysed, monkeypatch):
    """A second logger with a clock of its own may start seconds later."""
    drop = campaign.plank_drops[0]
    late = [replace(c, time_s=c.time_s + 60.0) for c in drop.log.channels[1:]]
    drop = replace(drop, log=replace(drop.log, channels=(drop.log.channels[0], *late)))
    altered = replace(campaign, plank_drops=(drop, *campaign.plank_drops[1:]))
    run = fitted_runs(altered, analysed, monkeypatch)[0]
    assert [c.sensor.kind for c in run.log.channels] == [drop.log.channels[0].sensor.kind]
    assert 0.0 < run.log.duration_s < 60.0
