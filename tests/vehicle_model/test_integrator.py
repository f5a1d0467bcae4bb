"""The fixed-step integrator against DOP853 on equations written out here for one rigid body on three axles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hand_written_truck import (
    DURATION_S,
    FINE_S,
    HEIGHTS_M,
    OUTPUT_S,
    SPEED_M_S,
    Truck,
    relative_rms,
)
from rigid_truck import FILTER
from scipy import signal
from simulated_truck import simulated_truck

QUANTITIES = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "horizontal_force")


@pytest.fixture(scope="session")
def oracle() -> list[dict[str, np.ndarray]]:
    """Histories (n, channels) of both bumps every 0.125 ms."""
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    return [Truck(height).histories(times) for height in HEIGHTS_M]


@pytest.fixture(scope="session")
def histories() -> dict[float, object]:
    """Histories at steps of 2.5, 1.25 and 0.625 ms."""
    return {h: simulated_truck(h) for h in (0.0025, 0.00125, 0.000625)}


def worst(histories, oracle, number: int) -> dict[str, float]:
    """Largest error of any axle or point, by quantity."""
    every = round(OUTPUT_S / FINE_S)
    return {
        q: relative_rms(np.asarray(getattr(histories, q))[:, number, :, 0], oracle[number][q][::every]).max()
        for q in QUANTITIES
    }


def test_all_axles_lift_off_on_one_bump_and_none_on_the_other(oracle):
    assert (oracle[0]["tire_force"].min(axis=0) == 0.0).all()
    assert (oracle[1]["tire_force"].min(axis=0) > 0.0).all()


@pytest.mark.parametrize(("step_s", "limit"), [(0.0025, 3e-3), (0.00125, 1e-4)])
def test_every_channel_with_lift_off(histories, oracle, step_s: float, limit: float):
    errors = worst(histories[step_s], oracle, 0)
    # The road under a wheel that pitch has moved by 17 mm is a third-order Taylor series: seen in the slope alone.
    assert errors.pop("horizontal_force") < 10 * limit
    assert max(errors.values()) < limit, errors


@pytest.mark.parametrize(("step_s", "limit"), [(0.0025, 5e-5), (0.00125, 3e-6)])
def test_every_channel_without_lift_off(histories, oracle, step_s: float, limit: float):
    errors = worst(histories[step_s], oracle, 1)
    assert max(errors.values()) < limit, errors


@pytest.mark.parametrize("acceleration_m_s2", [-1.5, pytest.param(1.0, marks=pytest.mark.long)])
def test_a_truck_that_brakes_or_gathers_speed(acceleration_m_s2: float):
    """From 8 m/s to 6.9 or 8.7 m/s at the last axle, with lift-off and without, against DOP853."""
    every = round(OUTPUT_S / FINE_S)
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    ours = simulated_truck(0.00125, acceleration_m_s2=acceleration_m_s2)
    for number, height in enumerate(HEIGHTS_M):
        exact = Truck(height, acceleration_m_s2=acceleration_m_s2).histories(times)
        errors = {
            q: relative_rms(np.asarray(getattr(ours, q))[:, number, :, 0], exact[q][::every]).max() for q in QUANTITIES
        }
        # Of a slope that pitch has moved the wheel along the Taylor series ends early, as above.
        assert errors.pop("horizontal_force") < (1e-3, 1e-4)[number]
        assert max(errors.values()) < (1e-4, 3e-6)[number], errors


def test_fourth_order_where_nothing_lifts_off(histories):
    """Errors of successive halvings fall by 2^4."""
    for q in QUANTITIES:
        values = [np.asarray(getattr(histories[h], q))[:, 1, :, 0] for h in sorted(histories, reverse=True)]
        coarse, fine = (np.sqrt(((a - b) ** 2).sum()) for a, b in pairwise(values))
        assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.1)


def test_sensors_see_the_filtered_histories(oracle):
    """Through the anti-alias filter, at the step of a 200 Hz campaign: against a fine simulation of the filter."""
    ours = np.asarray(simulated_truck(0.0025, filtered=True, rate_sensors=((0, None),)))[..., 0]
    b, a = signal.butter(FILTER.order, 2 * np.pi * FILTER.cutoff_hz, analog=True)
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    every = round(OUTPUT_S / FINE_S)
    for number in range(2):
        raw = np.concatenate([oracle[number][q] for q in (*QUANTITIES[:3], "pitch_rate")], axis=1)
        exact = np.stack([signal.lsim((b, a), column, times)[1][::every] for column in raw.T], axis=1)
        error = relative_rms(ours[:, number], exact)
        assert error.max() < (3e-3, 5e-5)[number], error


def test_speeds_a_hair_beside_the_nominal_one_give_the_same(histories):
    """At 8 m/s every look-up falls on a station; the neighbouring floating-point speed falls beside it."""
    beside = simulated_truck(0.00125, speed_m_s=np.nextafter(SPEED_M_S, 0.0))
    for q in QUANTITIES:
        ours, theirs = (np.asarray(getattr(h, q)) for h in (histories[0.00125], beside))
        assert np.abs(ours - theirs).max() < 1e-9 * np.abs(ours).max()
