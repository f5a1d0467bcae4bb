"""Natural modes against published finite element frequencies, closed forms, and energies of hand-written equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import DAMPING, EMPTY, STIFFNESS, VEHICLE
from vehicles import example_vehicle

from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.errors import SysidError
from sysid.vehicle_model.vibration_modes import natural_modes

#: VEqMon2D, articulated vehicle with eight axles: computed in Abaqus [Hz].
ABAQUS_HZ = [
    "1.4010", "1.5923", "1.9731", "4.8321", "7.3248", "8.8112", "12.351", "12.367", "12.661", "13.422", "29.174",
    "29.775",
]  # fmt: skip


def two_axles(sprung: float, inertia: float, height: float = 0.5, radius: float = 0.5) -> tuple[Vehicle, LoadCase]:
    """A symmetric vehicle, axles 1.5 m before and behind the centre of gravity."""
    axles = tuple(Axle(n, 0, x, 400.0, 1.9e6, 0.0, radius, "other") for n, x in (("front", 0.0), ("rear", 3.0)))
    load = LoadCase("only", (0.5 * sprung + 400.0,) * 2, (sprung,), (inertia,), (height,))
    return Vehicle("symmetric", (Body("body"),), axles), load


def quarter_car(k: float, kt: float, m: float, mu: float) -> np.ndarray:
    """Undamped frequencies [rad/s]: m mu w^4 - (m (k + kt) + mu k) w^2 + k kt = 0."""
    return np.sort(np.sqrt(np.roots([m * mu, -(m * (k + kt) + mu * k), k * kt])))


def test_articulated_vehicle_with_axle_groups():
    v = example_vehicle("veqmon2d")
    case = v.load_cases["only"]
    modes = natural_modes(v.vehicle, case, v.behind.stiffness["only"])
    assert [f"{f:.5g}".ljust(6, "0") for f in modes.frequency_hz] == ABAQUS_HZ
    assert modes.coordinates[-7:] == (
        "heave axle 1", "heave group 2", "pitch group 2", "heave group 3", "pitch group 3", "heave axle 7",
        "heave axle 8",
    )  # fmt: skip
    np.testing.assert_array_equal(modes.damping_ratio, 0.0)
    # The beams of both groups pitch by themselves: kt (2 e^2) / I at the pair, likewise at the three axles.
    assert modes.dominant[-2:] == ("pitch group 3", "pitch group 2")
    np.testing.assert_allclose(
        2 * np.pi * modes.frequency_hz[-2:], np.sqrt([3.5e6 * 2 * 1.2**2 / 300, 3.5e6 * 2 / 200]), rtol=1e-9
    )
    only_first = np.where(np.equal(v.vehicle.suspension_axle, range(8)), v.behind.stiffness["only"], np.nan)
    np.testing.assert_array_equal(natural_modes(v.vehicle, case, only_first).frequency_hz, modes.frequency_hz)


def test_quarter_car():
    """With the inertia m a^2, a half the wheelbase, both ends of a vehicle move as if the other were not there."""
    k, kt = 3.1e5, 1.9e6
    vehicle, load = two_axles(6000.0, 6000.0 * 1.5**2)
    modes = natural_modes(vehicle, load, np.full(2, k))
    expected = np.repeat(quarter_car(k, kt, 3000.0, 400.0), 2) / (2 * np.pi)
    np.testing.assert_allclose(modes.frequency_hz, expected, rtol=1e-9)


def test_symmetric_vehicle_heaves_and_pitches():
    """Heave is the quarter car of half the body, pitch one of half the inertia at the arm: I / (2 a^2)."""
    k, kt, inertia = 2.7e5, 1.9e6, 9000.0
    vehicle, load = two_axles(6000.0, inertia)
    modes = natural_modes(vehicle, load, np.full(2, k))
    heave, pitch = quarter_car(k, kt, 3000.0, 400.0), quarter_car(k, kt, inertia / (2 * 1.5**2), 400.0)
    expected = np.sort(np.concatenate([heave, pitch])) / (2 * np.pi)
    np.testing.assert_allclose(modes.frequency_hz, expected, rtol=1e-12)
    assert modes.dominant[:2] == ("heave body", "pitch body")
    # In heave the wheels follow the body by k / (k + kt - mu w^2), in pitch with opposite signs.
    follow = k / (k + kt - 400.0 * heave[0] ** 2)
    np.testing.assert_allclose(modes.body_motion[0, :, 0], [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(modes.wheel_rise[:, 0], follow, rtol=1e-9)
    np.testing.assert_allclose(modes.wheel_rise[0, 1], -modes.wheel_rise[1, 1], rtol=1e-9)
    assert modes.body_motion[0, 2, 1] * 1.5 == pytest.approx(1.0, rel=1e-9)


def test_heights_couple_travel_and_pitch():
    """Wheels below the centre of gravity: their mass adds to the inertia of pitch, and their springs hold it up."""
    k, kt, below = 2.7e5, 1.9e6, -0.9
    vehicle, load = two_axles(6000.0, 9000.0, height=1.4)
    modes = natural_modes(vehicle, load, np.full(2, k))
    # Travel and pitch: mass [[m + 2 mu, -2 mu b], [-2 mu b, I + 2 mu b^2]] without force on travel; tilt m g b.
    effective = 9000.0 + 800.0 * below**2 - (800.0 * below) ** 2 / 6800.0
    mass = np.diag([effective, 800.0])
    arm = 1.5
    stiffness = np.array([[2 * k * arm**2 + 6000.0 * 9.81 * below, 2 * k * arm], [2 * k * arm, 2 * (k + kt)]])
    square = np.linalg.eigvals(np.linalg.solve(mass, stiffness))
    pitch = np.sort(np.sqrt(square)) / (2 * np.pi)
    for f in pitch:
        assert np.abs(modes.frequency_hz / f - 1).min() < 1e-12
    travel, _, turn = modes.body_motion[0, :, modes.dominant.index("pitch body")]
    assert travel * 6800.0 == pytest.approx(800.0 * below * turn, rel=1e-9)


@pytest.mark.parametrize(("c", "ct"), [(9e3, 0.0), (3e4, 2e3), (1.1e5, 0.0), (9e3, 1.2e5)])
def test_damping_ratio_of_a_quarter_car(c: float, ct: float):
    """Poles of m mu s^4 + ... = 0, one body mode and one hop mode, also where one of them no longer oscillates."""
    k, kt, m, mu = 3.1e5, 1.9e6, 3000.0, 400.0
    vehicle, load = two_axles(6000.0, 6000.0 * 1.5**2)
    modes = natural_modes(vehicle, load, np.full(2, k), np.full(2, c), tire_damping=np.full(2, ct))
    body = np.polymul([m, c, k], [mu, c + ct, k + kt])
    poles = np.roots(np.polysub(body, np.polymul([c, k], [c, k])))
    oscillating = poles[poles.imag > 1e-6]
    expected = sorted((abs(s) / (2 * np.pi), -s.real / abs(s), s.imag / (2 * np.pi)) for s in oscillating)
    real = np.sort(np.abs(poles[np.abs(poles.imag) <= 1e-6]))
    assert (real.size == 0) == (c < 1e5 and ct < 1e5)
    found = [
        (abs(s) / (2 * np.pi), z, f)
        for s, z, f in zip(modes.pole, modes.damping_ratio, modes.damped_frequency_hz, strict=True)
        if f > 0
    ]
    np.testing.assert_allclose(sorted(found)[::2], expected, rtol=1e-6)
    np.testing.assert_allclose(sorted(found)[1::2], expected, rtol=1e-6)
    over = modes.damping_ratio[modes.damped_frequency_hz == 0]
    if real.size:
        np.testing.assert_allclose(over, real.sum() / (2 * np.sqrt(real.prod())), rtol=1e-6)
        assert (over > 1).all()


def test_lightly_damped_modes_of_a_truck_by_energy():
    """To first order zeta = phi' C phi / (2 omega phi' M phi): energy lost per cycle, from the shapes alone."""
    modes = natural_modes(VEHICLE, EMPTY, STIFFNESS, 0.01 * DAMPING, tire_damping=np.full(3, 30.0))
    below = np.array([a.tire_radius_m for a in VEHICLE.axles]) - EMPTY.cg_height_m[0]
    x = np.array([a.x_m for a in VEHICLE.axles])
    for j, f in enumerate(modes.frequency_hz):
        travel, heave, pitch = modes.body_motion[0, :, j]
        rise = modes.wheel_rise[:, j]
        stretch = heave - pitch * (x - modes.cg_x_m[0]) - rise
        lost = 0.01 * DAMPING @ stretch**2 + 30.0 * (rise**2).sum()
        unsprung = np.array([a.unsprung_mass_kg for a in VEHICLE.axles])
        energy = EMPTY.sprung_mass_kg[0] * (travel**2 + heave**2) + EMPTY.pitch_inertia_kg_m2[0] * pitch**2
        energy += unsprung @ (rise**2 + (travel - pitch * below) ** 2)
        assert modes.damping_ratio[j] == pytest.approx(lost / (4 * np.pi * f * energy), rel=1e-3)
        # Nothing holds it fore and aft: its momentum stays zero.
        total = EMPTY.sprung_mass_kg[0] * travel + unsprung @ (travel - pitch * below)
        assert total == pytest.approx(0.0, abs=1e-9 * EMPTY.sprung_mass_kg[0])
    assert modes.frequency_hz[0] > 1.0  # the rigid fore-aft motion is not among the modes
    assert len(modes.frequency_hz) == len(modes.coordinates) - 1


def test_table():
    modes = natural_modes(VEHICLE, EMPTY, STIFFNESS, DAMPING)
    table = modes.summary()
    assert list(table.columns) == ["mode", "frequency_hz", "damping_ratio", "damped_frequency_hz", "moves_most"]
    assert list(table["mode"]) == [1, 2, 3, 4, 5]
    assert "heave truck" in modes._repr_html_()


def test_a_vehicle_that_tips_over_has_no_modes():
    high = replace(EMPTY, cg_height_m=(400.0,))
    with pytest.raises(SysidError, match="tips over"):
        natural_modes(VEHICLE, high, STIFFNESS)
    with pytest.raises(SysidError, match="without any restoring force"):
        natural_modes(*two_axles(6000.0, 9000.0), np.zeros(2))


@pytest.mark.parametrize(
    ("values", "words"), [([1e5, 2e5], "one value for each of 3 axles"), ([1e5, -1.0, np.nan], "stiffness of axle 3")]
)
def test_bad_values_are_named(values, words):
    with pytest.raises(SysidError, match=words):
        natural_modes(VEHICLE, EMPTY, values)
