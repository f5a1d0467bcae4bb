"""Tires, speed and road of a drive against a linear truck whose equations are written down here."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sysid.balance import ForceBalance, balance_forces, smooth_roads
from sysid.campaign.records import Acquisition, Campaign, Channel, Log, RoadDrive, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle

STEP, COUNT, SPEED, DENSITY = 0.005, 6000, 16.0, 64e-6
X = np.array([0.0, 3.8, 5.1])
UNSPRUNG, LOADS = np.array([550.0, 900.0, 900.0]), np.array([6000.0, 7500.0, 7000.0])
K, C = np.array([3.2e5, 6.5e5, 5.8e5]), np.array([1.1e4, 1.6e4, 1.3e4])
KT, CT = np.array([1.8e6, 3.1e6, 2.9e6]), np.array([3e3, 5e3, 4.5e3])
MASS, INERTIA, RADIUS = float(LOADS.sum() - UNSPRUNG.sum()), 4.0e4, 0.5


def spectra(one_road: bool, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, and heave, pitch and three axles of the truck on a periodic road, G (n / 0.1)^-2."""
    rng = np.random.default_rng(seed)
    hz = np.fft.rfftfreq(COUNT, STEP)
    omega = 2.0 * np.pi * hz
    wave = np.maximum(hz, 1e-9) / SPEED
    # One-sided density over frequency is that over wave number by the speed.
    density = np.where((hz > 0.3) & (hz < 24.0), DENSITY * (wave / 0.1) ** -2 / SPEED, 0.0)
    size = np.sqrt(density * COUNT / STEP / 2.0) / np.sqrt(2.0)
    road = size * (rng.normal(size=(3, hz.size)) + 1j * rng.normal(size=(3, hz.size)))
    felt = (road[:1] if one_road else road) * np.exp(-1j * omega * X[:, None] / SPEED)
    carried = LOADS - UNSPRUNG
    arm = X - float(carried @ X / carried.sum())
    stretch = np.concatenate([np.ones((3, 1)), -arm[:, None], -np.eye(3)], axis=1)
    mass, motion = np.diag([MASS, INERTIA, *UNSPRUNG]), np.zeros((5, hz.size), complex)
    for f, w in enumerate(omega):
        tire = np.concatenate([np.zeros(2), KT + 1j * w * CT])
        matrix = -(w**2) * mass + stretch.T @ ((K + 1j * w * C)[:, None] * stretch) + np.diag(tire)
        motion[:, f] = np.linalg.solve(matrix, tire * np.concatenate([np.zeros(2), felt[:, f]]))
    return omega, motion


def drive(one_road: bool = True, told_m_s: float = SPEED, rougher: float = 1.0, noise: float = 1.0) -> Campaign:
    omega, motion = spectra(one_road, 5)
    motion = motion * np.sqrt(rougher)
    carried = LOADS - UNSPRUNG
    arm = X - float(carried @ X / carried.sum())
    frame = motion[0] - np.outer(arm, motion[1])
    rng = np.random.default_rng(6)
    channels = []
    for kind, values, sd in (
        ("q", frame - motion[2:], 3e-4), ("a", -(omega**2) * motion[2:], 0.2), ("b", -(omega**2) * frame, 0.15)
    ):  # fmt: skip
        for i, shown in enumerate(np.fft.irfft(values, COUNT, axis=1)):
            sensor = {
                "q": Sensor(f"q{i}", "suspension_deflection", "m", axle=i),
                "a": Sensor(f"a{i}", "axle_acceleration", "m/s^2", axle=i),
                "b": Sensor(f"b{i}", "body_acceleration", "m/s^2", body=0, x_m=float(X[i])),
            }[kind]
            noisy = shown + noise * sd * rng.normal(size=COUNT)
            channels.append(Channel(sensor, STEP * np.arange(COUNT), noisy, np.zeros(COUNT, np.int8)))
    axles = tuple(
        Axle(f"axle {i}", 0, float(X[i]), float(UNSPRUNG[i]), 1.08 * float(KT[i]), 3e3, RADIUS, "leaf",
             suspension_law="linear") for i in range(3)
    )  # fmt: skip
    case = LoadCase("only", tuple(LOADS.tolist()), (MASS,), (INERTIA,), (RADIUS,))
    log = Log("drive.csv", STEP, tuple(channels))
    return Campaign(
        "drawn", "", Path(), Path("campaign.toml"), Vehicle("truck", (Body("body"),), axles), {"only": case},
        Acquisition(STEP, None), (), (), {}, (), {}, road_drives=(RoadDrive("only", told_m_s, log),),
    )  # fmt: skip


@cache
def found() -> ForceBalance:
    """The declared tires are 8 % too stiff, the speedometer shows 2 % too much."""
    return balance_forces(drive(told_m_s=1.02 * SPEED))


def test_tires_come_back_with_their_intervals() -> None:
    stiffness = [e for e in found().tires if e.quantity == "tire_stiffness"]
    assert [e.name for e in stiffness] == ["kt_1", "kt_2", "kt_3"]
    assert [e.value for e in stiffness] == pytest.approx(KT, rel=0.03)
    assert all(e.low < t < e.high for e, t in zip(found().tires, (*KT, *CT), strict=True))
    # Unsprung masses are known to 8 %, and tires with them.
    assert all(1.1 < e.high / e.value < 1.3 for e in stiffness)


def test_speed_and_road_come_back_with_their_intervals() -> None:
    (road,) = found().roads
    assert road.speed_m_s == pytest.approx(SPEED, rel=2e-3)
    assert road.speed_low < SPEED < road.speed_high
    assert road.density_low < DENSITY < road.density_high
    assert road.density_high < 3.0 * road.density_low
    assert road.waviness == pytest.approx(2.0, abs=0.25)
    assert road.road_class == "B"


def test_axles_on_roads_of_their_own_tell_no_tires() -> None:
    alone = balance_forces(drive(one_road=False))
    assert alone.tires == alone.roads == ()
    assert any("do not roll over one road" in s for s in alone.sentences)
    # k and c need no road.
    assert [e.value for e in alone.estimates if e.quantity == "stiffness"] == pytest.approx(K, rel=0.02)


def test_a_short_drive_tells_no_tires() -> None:
    given = drive()
    (road,) = given.road_drives
    cut = tuple(
        replace(c, time_s=c.time_s[:3000], value=c.value[:3000], censored=c.censored[:3000]) for c in road.log.channels
    )
    short = balance_forces(replace(given, road_drives=(replace(road, log=replace(road.log, channels=cut)),)))
    assert short.tires == ()
    assert any("too short" in s for s in short.sentences)


def test_a_drive_that_is_too_smooth_says_what_to_drive():
    """What `check` foresees is what the balance finds, and the road that it asks for is enough."""
    smooth = drive(rougher=0.25, noise=10.0)
    (said,) = smooth_roads(smooth)
    found = balance_forces(smooth)
    vague = [e for e in found.estimates if not e.determined]
    assert vague
    assert "of class A" in said
    assert all(f"{e.name[0]} of axle {e.axle + 1}" in said for e in vague)
    asked = re.search(r"over a road of class (\w)", said)
    assert asked
    rougher = 16e-6 * 4.0 ** "ABCD".index(asked[1]) / DENSITY
    assert rougher > 0.25
    assert all(e.determined for e in balance_forces(drive(rougher=rougher, noise=10.0)).estimates)
    assert smooth_roads(drive(rougher=rougher, noise=10.0)) == []
