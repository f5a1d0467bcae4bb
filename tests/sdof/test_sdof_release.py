"""When a record begins to move: the same at every rate of the logger."""

from __future__ import annotations

import numpy as np
import pytest
from decay_oracles import damped_cosine

from sysid.sdof.release import find_release

RATES_HZ = (100.0, 200.0, 1000.0, 2000.0)
VIBRATION_M, NOISE_M = 2e-4, 5e-5
AT_REST_M = float(np.hypot(VIBRATION_M / np.sqrt(2.0), NOISE_M))


def released(rest_s, rate_hz):
    """A drop after a rest with the engine running, besides white noise."""
    time = np.arange(0.0, 4.0, 1.0 / rate_hz)
    vibration = VIBRATION_M * np.sin(2.0 * np.pi * 12.0 * time + 0.5)
    noise = NOISE_M * np.random.default_rng(1).standard_normal(time.size)
    return find_release(time, damped_cosine(time, 0.6, 0.5, release_s=rest_s) + vibration + noise)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_log_that_begins_at_the_release_does_not_take_the_motion_for_noise(rate_hz):
    assert released(0.02, rate_hz).noise_sd < 2.0 * AT_REST_M


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_short_rest_is_seen_at_every_rate(rate_hz):
    """The standard rate of 200 Hz tells what the others must find."""
    found, standard = released(0.12, rate_hz), released(0.12, 200.0)
    assert found.time_s == pytest.approx(standard.time_s, abs=0.012)
    assert found.rest_level == pytest.approx(standard.rest_level, abs=2e-4)
    assert found.noise_sd == pytest.approx(standard.noise_sd, rel=0.4)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("rest_s", [0.5, 1.0])
def test_release_level_and_noise_after_a_rest(rest_s, rate_hz):
    found = released(rest_s, rate_hz)
    assert found.time_s == pytest.approx(rest_s, abs=0.03)
    assert found.rest_level == pytest.approx(0.04, abs=2e-4)
    assert found.noise_sd == pytest.approx(AT_REST_M, rel=0.6)
