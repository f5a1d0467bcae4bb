"""Delays between axles that meet one road one after the other, by a road that is moved here."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.bookkeeping.drives import drive_complaints
from sysid.campaign.records import Acquisition, Campaign, Channel, Log, RoadDrive, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle

STEP, COUNT = 0.005, 6000
X = (0.0, 4.0, 5.3, 12.0)


def drive(speed_m_s: float, told_m_s: float, seed: int, turned: int | None = None) -> RoadDrive:
    """Accelerations of axles that follow one random road, each with noise of its own."""
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * np.fft.rfftfreq(COUNT, STEP)
    size = np.where((omega > 2.0) & (omega < 120.0), omega, 0.0)
    road = size * (rng.normal(size=omega.size) + 1j * rng.normal(size=omega.size))
    channels = []
    for i, x in enumerate(X):
        felt = np.fft.irfft(road * np.exp(-1j * omega * x / speed_m_s), COUNT) * (-1.0 if i == turned else 1.0)
        felt = felt + 0.3 * felt.std() * rng.normal(size=COUNT)
        sensor = Sensor(f"a{i}", "axle_acceleration", "m/s^2", axle=i)
        channels.append(Channel(sensor, STEP * np.arange(COUNT), felt, np.zeros(COUNT, np.int8)))
    return RoadDrive("only", told_m_s, Log(f"drive{seed}.csv", STEP, tuple(channels)))


def campaign(*drives: RoadDrive, x: tuple[float, ...] = X) -> Campaign:
    axles = tuple(Axle(f"axle {i + 1}", 0, p, 600.0, 2.5e6, 3e3, 0.5, "leaf") for i, p in enumerate(x))
    case = LoadCase("only", (5000.0,) * len(x), (17600.0,), (5e4,), (1.0,))
    return Campaign(
        "drawn", "", Path(), Path("campaign.toml"), Vehicle("truck", (Body("body"),), axles), {"only": case},
        Acquisition(STEP, None), (), (), {}, (), {}, road_drives=drives,
    )  # fmt: skip


def test_places_and_speeds_that_are_right_are_not_accused() -> None:
    assert drive_complaints(campaign(drive(16.0, 16.3, 1), drive(11.0, 10.7, 2), drive(22.0, 22.0, 3))) == []


@pytest.mark.parametrize(("axle", "place"), [(2, 4.7), (3, 6.1), (4, 10.6)])
def test_an_axle_at_another_place_is_named(axle: int, place: float) -> None:
    wrong = tuple(place if i == axle - 1 else x for i, x in enumerate(X))
    (said,) = drive_complaints(campaign(drive(16.0, 16.0, 1), drive(11.0, 11.0, 2), x=wrong))
    named = re.search(r"axle (\d) is at ([\d.]+) m", said)
    assert named is not None
    assert int(named[1]) == axle
    assert float(named[2]) == pytest.approx(X[axle - 1], abs=0.1)


def test_a_wrong_speed_is_named_with_its_drive() -> None:
    (said,) = drive_complaints(campaign(drive(16.0, 16.0, 1), drive(11.0, 13.9, 2)))
    assert said.startswith("drive2.csv")
    assert "as at 40 km/h, and 50 km/h is given" in said


def test_an_axle_with_the_wrong_sign_is_named() -> None:
    (said,) = drive_complaints(campaign(drive(16.0, 16.0, 1, turned=1), drive(11.0, 11.0, 2, turned=1)))
    assert "axle 2 moves against" in said


def test_two_axles_leave_open_whether_speed_or_place_is_wrong() -> None:
    given = drive(11.0, 13.9, 2)
    two = replace(given, log=replace(given.log, channels=given.log.channels[:2]))
    (said,) = drive_complaints(campaign(two, x=X[:2]))
    assert "or at x_m" in said


def test_axles_on_roads_of_their_own_say_nothing() -> None:
    given, other = drive(16.0, 16.0, 1), drive(16.0, 16.0, 9)
    mixed = (*given.log.channels[:1], *other.log.channels[1:2], *drive(16.0, 16.0, 8).log.channels[2:3])
    assert drive_complaints(campaign(replace(given, log=replace(given.log, channels=mixed)), x=X[:3])) == []
