"""Force balance and plank compression against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.bookkeeping.drops import compressions
from sysid.bookkeeping.force_balance import balance, run_spectra
from sysid.campaign.records import BumpRun, Channel, Log, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle

STEP = 0.005


def vehicle(places, tire=2e6):
    axles = tuple(Axle(f"axle {i}", 0, x, 500.0, tire, 3e3, 0.5, "leaf") for i, x in enumerate(places))
    return Vehicle("truck", (Body("body"),), axles)


def load_case(loads, inertia=20_000.0):
    return LoadCase("only", tuple(loads), (sum(loads) - 500.0 * len(loads),), (inertia,), (1.0,))


def test_a_beam_on_three_equal_springs():
    """Middle support raised by h: the beam follows by h / 3, so that 2/3 k_s h presses, k_s = k kt / (k + kt)."""
    k, tire = 4e5, 2e6
    series = k * tire / (k + tire)
    made = compressions(vehicle((0.0, 3.0, 6.0), tire), np.full(3, k))
    assert made[1] == pytest.approx(2.0 / 3.0 * series / k, rel=1e-9)
    # By symmetry and moments: the outer ones carry a quarter of that.
    assert made[0] == pytest.approx(made[1] / 4.0, rel=1e-9)


def test_two_axles_are_compressed_by_no_plank():
    """Statically determined: what the wheels carry does not change."""
    made = compressions(vehicle((0.0, 4.0)), np.array([3e5, 5e5]))
    assert made == pytest.approx([0.0, 0.0], abs=1e-9)


def made_run(k, c, case, places):
    """Deflections as chosen; heave and pitch of the frame follow from Newton's law."""
    time = np.arange(2400) * STEP
    burst = np.exp(-(((time - 5.0) / 1.2) ** 2))
    mass, inertia = case.sprung_mass_kg[0], case.pitch_inertia_kg_m2[0]
    loads = np.array(case.axle_loads_kg) - 500.0
    centre = float(loads @ np.array(places) / loads.sum())
    shapes = [burst * np.sin(2 * np.pi * f * time + p) for f, p in ((1.3, 0.0), (1.9, 1.0), (2.7, 2.0))]
    deflections = [0.02 * shapes[0], 0.015 * shapes[1], 0.01 * shapes[2]]
    forces = [-(k[i] * q + c[i] * np.gradient(q, STEP)) for i, q in enumerate(deflections)]
    heave = sum(forces) / mass
    pitch = sum(-(x - centre) * f for x, f in zip(places, forces, strict=True)) / inertia
    channels = []
    for i, x in enumerate(places):
        q = Sensor(f"q{i}", "suspension_deflection", "m", axle=i)
        b = Sensor(f"b{i}", "body_acceleration", "m/s^2", body=0, x_m=x)
        free = np.zeros(time.size, np.int8)
        channels += [Channel(q, time, deflections[i], free), Channel(b, time, heave - (x - centre) * pitch, free)]
    return BumpRun("case", case.name, 4.0, 1, Log("run.csv", STEP, tuple(channels)))


def test_stiffness_and_damping_come_back_from_newtons_law():
    places, k, c = (0.0, 4.0, 5.5), (4e5, 3e5, 5e5), (1e4, 8e3, 1.2e4)
    case, truck = load_case((4000.0, 5000.0, 6000.0)), vehicle((0.0, 4.0, 5.5))
    spectra = run_spectra(made_run(k, c, case, places), truck)
    assert spectra is not None
    found = balance([spectra], truck, [case])
    assert found is not None
    assert found.stiffness == pytest.approx(k, rel=2e-3)
    assert found.damping == pytest.approx(c, rel=2e-2)
    assert found.unexplained < 1e-4


def test_a_lost_deflection_follows_from_the_accelerations_of_frame_and_axle():
    places, k = (0.0, 4.0, 5.5), (4e5, 3e5, 5e5)
    case, truck = load_case((4000.0, 5000.0, 6000.0)), vehicle(places)
    run = made_run(k, (1e4, 8e3, 1.2e4), case, places)
    q, b = run.log.channels[2:4]
    kept = tuple(c for c in run.log.channels if c is not q)
    lost = replace(run, log=replace(run.log, channels=kept))
    assert run_spectra(lost, truck) is None
    # Below the frame, the axle moves with a = b - q''.
    twice = np.gradient(np.gradient(q.value, STEP), STEP)
    a = Channel(Sensor("a1", "axle_acceleration", "m/s^2", axle=1), b.time_s, b.value - twice, b.censored)
    spectra = run_spectra(replace(run, log=replace(run.log, channels=(*kept, a))), truck)
    assert spectra is not None
    found = balance([spectra], truck, [case])
    assert found is not None
    assert found.stiffness == pytest.approx(k, rel=5e-3)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_a_wrong_inertia_comes_back_as_its_factor(factor):
    places = (0.0, 4.0, 5.5)
    case, truck = load_case((4000.0, 5000.0, 6000.0)), vehicle(places)
    spectra = run_spectra(made_run((4e5, 3e5, 5e5), (1e4, 8e3, 1.2e4), case, places), truck)
    assert spectra is not None
    wrong = load_case((4000.0, 5000.0, 6000.0), 20_000.0 * factor)
    found = balance([spectra], truck, [wrong], "inertia")
    assert found is not None
    loads = np.array(case.axle_loads_kg) - 500.0
    about = case.sprung_mass_kg[0] * float(loads @ np.array(places) / loads.sum()) ** 2
    assert found.freed[0] == pytest.approx((20_000.0 + about) / (factor * 20_000.0 + about), rel=5e-3)
