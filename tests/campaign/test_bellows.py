"""Air pressures as extensions of bellows: the gas law in closed form, what is refused, and the fit's channel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rigid_truck

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.quality.bellows import ATMOSPHERE_PA, USUAL_HEIGHT_M, extension, with_bellows
from sysid.campaign.records import BumpRun, Channel, Log, Sensor
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.vehicle_model.readings import eliminate_sensors

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
STEP, HEIGHT_M, REST_PA = 0.005, 0.18, 5.2e5
TIME = np.arange(1200) * STEP
EXTENSION_M = 0.05 * np.exp(-np.clip(TIME - 2.0, 0.0, None)) * np.sin(9.0 * np.clip(TIME - 2.0, 0.0, None))


def gauge(extension_m: np.ndarray, height_m: float = HEIGHT_M) -> np.ndarray:
    """Gauge pressure [Pa] of enclosed air, p V^1.38 constant, over an area that does not change."""
    return (REST_PA + ATMOSPHERE_PA) * (1.0 + extension_m / height_m) ** -1.38 - ATMOSPHERE_PA


def channel(value, column="p", kind="air_pressure", unit="bar", step=STEP, **place) -> Channel:
    time = np.arange(value.size) * step
    return Channel(Sensor(column, kind, unit, **place), time, value, np.zeros(value.size, np.int8))


def run_of(pressure: Channel, deflection: np.ndarray = EXTENSION_M) -> BumpRun:
    lvdt = channel(deflection, "q", "suspension_deflection", "mm", axle=1)
    return BumpRun("case", "unloaded", 4.0, 1, Log("run.csv", STEP, (lvdt,), auxiliary=(pressure,)))


def bellows(run: BumpRun):
    made, said = with_bellows(replace(read_campaign(DATA), bump_runs=(run,)))
    return made.bump_runs[0].log, said


def test_the_extension_is_exact_but_for_its_factor():
    made = extension(channel(gauge(EXTENSION_M), axle=1))
    assert made.sensor.kind == "bellows_extension"
    assert made.sensor.si_unit == "m"
    factor = USUAL_HEIGHT_M / HEIGHT_M
    # At rest most of the time: the median is the pressure at rest.
    np.testing.assert_allclose(made.value, factor * EXTENSION_M, atol=2e-4)
    # The pressure itself is no straight line of the extension.
    line = np.polyval(np.polyfit(EXTENSION_M, gauge(EXTENSION_M), 1), EXTENSION_M)
    assert np.abs(line - gauge(EXTENSION_M)).max() > 0.05 * np.ptp(gauge(EXTENSION_M))


def test_a_pressure_becomes_a_channel_of_its_axle():
    log, said = bellows(run_of(channel(gauge(EXTENSION_M), axle=1)))
    assert said == ()
    assert [(c.sensor.kind, c.sensor.axle) for c in log.channels] == [
        ("suspension_deflection", 1),
        ("bellows_extension", 1),
    ]
    assert [c.sensor.kind for c in log.auxiliary] == ["air_pressure"]


def test_a_campaign_that_is_checked_again_stays_as_it_is():
    """As selftests do with the runs of a checked campaign."""
    data = replace(read_campaign(DATA), bump_runs=(run_of(channel(gauge(EXTENSION_M), axle=1)),), plank_drops=())
    once, _ = check_quality(data)
    twice, report = check_quality(once)
    kinds = [[c.sensor.kind for c in checked.bump_runs[0].log.channels] for checked in (once, twice)]
    assert kinds[0] == kinds[1] == ["suspension_deflection", "bellows_extension"]
    assert all(f.verdict != "rejected" for f in report.channels), report.channels


@pytest.mark.parametrize(
    ("pressure", "words"),
    [
        (channel(gauge(EXTENSION_M)[::4], step=4 * STEP, axle=1), "more slowly"),
        (channel(np.round(gauge(EXTENSION_M), -5), axle=1), "too coarse"),
        (channel(np.full(1200, 5e5), axle=1), "too coarse"),
        (channel(gauge(-EXTENSION_M), axle=1), "rises where 'q' shows that the suspension extends"),
        (channel(1e-3 * gauge(EXTENSION_M), axle=1), "hold no pressure"),
        (channel(np.full(1200, np.nan), axle=1), "too few readings"),
    ],
)
def test_a_pressure_that_does_not_show_the_motion_is_said(pressure, words):
    log, (sentence,) = bellows(run_of(pressure))
    assert len(log.channels) == 1
    assert "'p' is used at rest only" in sentence
    assert words in sentence


def test_the_fit_reads_the_extension_with_a_gain_of_its_own():
    """Readings made by the gas law from the simulated extension: the model explains them, at the ratio of heights."""
    sensor = Sensor("p", "bellows_extension", "m", axle=1)
    data = rigid_truck.campaign([rigid_truck.empty_run("a.csv", 7.0, sensors=(*rigid_truck.SENSORS, sensor))])
    model = bump_model(data, campaign_parameters(data, None), {"bump": rigid_truck.bump()})
    kinds = [s.kind for s in model.layout.sensors]
    at, lvdt = kinds.index("bellows_extension"), 1
    motion = RunMotion.steady(np.array([7.1]), np.array([0.35]))
    (shown,) = simulate_runs(model, model.parameters.start, motion)
    np.testing.assert_array_equal(shown[..., at], shown[..., lvdt])
    made = extension(channel(gauge(shown[:, 0, at]), axle=1))
    value = shown.copy()
    value[:, 0, at] = made.value
    readings = model.arrays[0]._replace(value=value, measured=np.ones_like(value), censored=np.zeros_like(value))
    ones = np.ones(shown.shape[1:])
    found = eliminate_sensors(readings.readings(1e-4 * ones, ones), shown[..., None])
    gain = np.asarray(found.gain)[0, :, 0]
    assert gain[at] == pytest.approx(USUAL_HEIGHT_M / HEIGHT_M, rel=0.01)
    assert gain[lvdt] == pytest.approx(1.0, abs=1e-12)
    left = np.asarray(found.offset)[0, at, 0] + gain[at] * shown[:, 0, at] - made.value
    assert np.abs(left).max() < 1e-3 * np.abs(made.value).max()
