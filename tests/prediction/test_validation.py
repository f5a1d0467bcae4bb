"""Agreement of histories: closed forms of the normalised error, clipped and missing samples left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.residuals.run_history import RunHistory
from sysid.validation import nrmse, validate
from sysid.validation.agreement import history_agreement


def test_normalised_error_of_a_sine_and_its_shifted_copy():
    """RMS of sin(x) - sin(x + a) is sqrt(2) |sin(a / 2)|; the span of a sine is 2."""
    x = np.linspace(0.0, 2 * np.pi, 10_000, endpoint=False)
    shift = 0.3
    exact = np.sqrt(2.0) * np.sin(shift / 2) / 2.0
    assert nrmse(np.sin(x), np.sin(x + shift)) == pytest.approx(exact, rel=1e-6)


def test_a_constant_difference_over_the_span():
    measured = np.array([0.0, 4.0, 2.0])
    assert nrmse(measured, measured + 1.0) == pytest.approx(0.25)
    assert nrmse(measured, measured) == 0.0
    assert nrmse(1000.0 * measured, 1000.0 * (measured + 1.0)) == pytest.approx(0.25)


def test_missing_samples_count_on_neither_side():
    measured = np.array([0.0, np.nan, 4.0, 2.0, 100.0])
    simulated = np.array([1.0, 50.0, 5.0, 3.0, np.nan])
    assert nrmse(measured, simulated) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("measured", "simulated"),
    [(np.full(3, np.nan), np.zeros(3)), (np.zeros(3), np.full(3, np.nan)), (np.ones(3), np.zeros(3)), ([], [])],
)
def test_without_readings_or_without_a_span_there_is_no_number(measured, simulated):
    assert np.isnan(nrmse(np.asarray(measured, float), np.asarray(simulated, float)))


def history() -> RunHistory:
    """Three channels of one run: plain, half clipped, dead."""
    n = 200
    clean = np.stack([np.sin(np.linspace(0, 12, n)), 3.0 * np.cos(np.linspace(0, 9, n)), np.zeros(n)])
    measured = clean.copy()
    measured[0] += 0.1
    measured[1] = np.clip(clean[1], -2.0, 2.0)
    measured[2] = np.nan
    censored = np.zeros((3, n), np.int8)
    censored[1] = (clean[1] >= 2.0).astype(np.int8) - (clean[1] <= -2.0).astype(np.int8)
    return RunHistory(
        file="runs/a.csv",
        case="a",
        load_case="empty",
        speed_m_s=5.0,
        speed_sd=0.01,
        speed_change=0.0,
        start_s=1.0,
        columns=("lvdt", "accel", "dead"),
        kinds=("suspension_deflection", "axle_acceleration", "axle_acceleration"),
        si_units=("m", "m/s^2", "m/s^2"),
        axles=(0, 1, 2),
        time_s=np.arange(n) * 0.005,
        measured=measured,
        simulated=clean,
        censored=censored,
        noise_sd=np.array([0.1, 0.2, np.inf]),
        instrument_noise_sd=np.array([0.05, 0.1, np.inf]),
        rolling_noise_sd=np.zeros(3),
        offset=np.zeros(3),
        gain=np.ones(3),
    )


def test_residuals_are_judged_by_what_the_sensor_shows_before_the_bump():
    smooth = history()
    rough = replace(smooth, rolling_noise_sd=4.0 * smooth.instrument_noise_sd[:2].max() + np.zeros(3))
    for a, b in zip(history_agreement(smooth), history_agreement(rough), strict=True):
        noise = smooth.instrument_noise_sd[smooth.columns.index(a.column)]
        assert b.residual_over_noise == pytest.approx(a.residual_over_noise * noise / 0.4)


def test_channels_without_readings_are_left_out_and_clipped_samples_too():
    class Fit:
        histories = (history(),)

    found = validate(Fit())  # only the histories are read
    assert [(c.run, c.column, c.axle) for c in found.channels] == [
        ("runs/a.csv", "lvdt", 0),
        ("runs/a.csv", "accel", 1),
    ]
    plain, clipped = found.channels
    assert plain.samples == 200
    assert plain.nrmse == pytest.approx(0.1 / np.ptp(history().measured[0]), rel=1e-9)
    assert plain.residual_over_noise == pytest.approx(2.0, rel=1e-9)
    assert clipped.samples == int((history().censored[1] == 0).sum())
    assert clipped.nrmse == 0.0
    assert "histories" in FitResult.__dataclass_fields__


def test_a_run_with_gaps_in_every_channel_is_compared_without_a_rating():
    """A logger that lost 8 % of a run: a rating would rate what interpolation puts there."""
    whole = history()
    measured = whole.measured.copy()
    measured[:, ::12] = np.nan
    rows = history_agreement(replace(whole, measured=measured))
    assert len(rows) == len(history_agreement(whole))
    assert np.isnan([row.iso18571 for row in rows]).all()
    assert np.isfinite([row.nrmse for row in rows]).all()
