"""Frames that bend: shape and modal mass against beams in closed form, passes over a bump against DOP853, modes."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import DURATION_S, FINE_S, POINTS_M, SPEED_M_S, Bend, Truck, worst_error
from independent_truck import Bending, Equations, IndependentTruck
from rigid_truck import AXLES, DAMPING, EMPTY, LADEN, STIFFNESS, VEHICLE
from scipy.integrate import quad
from scipy.linalg import eigh
from scipy.optimize import brentq, fsolve
from simulated_truck import per_axle, simulated_truck, truck_model

from sysid.campaign.vehicle_records import Axle, Body, FrameBending, FrameMass, LoadCase, Vehicle
from sysid.errors import CampaignError
from sysid.vehicle_model.bending import frame_modes, free_beam
from sysid.vehicle_model.suspension import FrameLaw, SuspensionLaw
from sysid.vehicle_model.vibration_modes import natural_modes

HZ, RATIO = 8.0, 0.025
BENT = replace(VEHICLE, bodies=(Body("truck", bending=FrameBending(HZ, RATIO)),))
HEIGHTS_M = (0.045, 0.006)


# ------------------------------------------------------------------------------------------------- shape and modal mass


def beam(mass: float, inertia: float, length: float = 6.0) -> tuple[Vehicle, LoadCase]:
    """A symmetric body on two axles at its ends, without unsprung mass to speak of."""
    axles = tuple(Axle(n, 0, x, 1.0, 1e6, 0.0, 0.5, "other") for n, x in (("front", 0.0), ("rear", length)))
    vehicle = Vehicle("beam", (Body("beam", bending=FrameBending(HZ, RATIO)),), axles)
    return vehicle, LoadCase("only", (0.5 * mass + 1.0,) * 2, (mass,), (inertia,), (0.5,))


def test_a_uniform_beam_is_exact():
    """I = m L^2 / 12: psi itself, and the modal mass of a shape of mean square 1 is the beam's mass."""
    mass, length = 9000.0, 6.0
    (mode,) = frame_modes(*beam(mass, mass * length**2 / 12.0, length))
    assert mode.modal_mass == pytest.approx(mass, rel=1e-9)
    b = brentq(lambda v: np.cos(v) * np.cosh(v) - 1.0, 4.0, 5.0, xtol=1e-14)
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    for t in (0.0, 0.3, 0.5, 1.0):
        exact = np.cosh(b * t) + np.cos(b * t) - ratio * (np.sinh(b * t) + np.sin(b * t))
        assert mode.rise(length * t) == pytest.approx(exact, abs=1e-9)
    assert (mode.rise(0.0), mode.rise(3.0)) == pytest.approx((2.0, -1.2156), abs=1e-4)


def test_a_part_on_springs_of_its_own_moves_as_the_eigenvector_of_frame_and_part():
    """A cab of 700 kg over the front axle: heave and pitch of the frame below it, and its own heave, by eigh."""
    mass, inertia, length, part, at, spring = 8000.0, 24000.0, 6.0, 700.0, 0.4, 110e3
    vehicle, case = beam(mass, inertia, length)
    own = FrameBending(HZ, RATIO, own_mass=(part, at))
    (mode,) = frame_modes(replace(vehicle, bodies=(Body("beam", bending=own),)), case)
    rest, centre = mass - part, 0.5 * length
    below = (mass * centre - part * at) / rest
    pitch = inertia - part * (at - centre) ** 2 - rest * (below - centre) ** 2
    # Coordinates: rise of the frame's own centre, its slope, rise of the part.
    stretch = np.array([-1.0, -(at - below), 1.0])
    squared, vectors = eigh(spring * np.outer(stretch, stretch), np.diag([rest, pitch, part]))
    vector = vectors[:, -1] / (stretch @ vectors[:, -1])
    for x in (0.0, 2.0, 6.0):
        assert mode.rise(x) == pytest.approx(vector[0] + vector[1] * (x - below), rel=1e-9)
    assert mode.modal_mass == pytest.approx(spring / squared[-1], rel=1e-9)
    # Without the heave of the frame it would move less.
    assert abs(vector[0]) > 0.05


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_frequency_of_a_uniform_beam_with_end_masses(share):
    """A beam of mass m with a mass M = share m at each end: symmetric modes have tan(b/2) + tanh(b/2) = -2 share b.

    Its bending stiffness is that of the uniform beam; the package knows mass and inertia alone.  With a shape that is
    not the exact one the frequency comes out a little high (Rayleigh), from its stiffness and its own modal mass.
    """
    m, length = 8000.0, 6.0
    end = share * m
    total, inertia = m + 2 * end, m * length**2 / 12.0 + 2 * end * (0.5 * length) ** 2
    # E I w'''' = mu omega^2 w; at an end E I w''' = M omega^2 w: in b = beta L with cos and cosh about the middle.
    b = brentq(lambda v: np.tan(v / 2) + np.tanh(v / 2) + 2 * share * v, np.pi + 1e-6, 4.7300407449)
    exact = (b / 4.730040744862704) ** 2  # omega over that of the beam alone, omega^2 = E I b^4 / (mu L^4)
    (mode,) = frame_modes(*beam(total, inertia, length))
    # The modal stiffness of psi is that of the beam alone: omega_0^2 m.
    ours = np.sqrt(m / mode.modal_mass)
    assert exact < ours < 1.01 * exact
    assert exact < 0.9


def shifted_beam(e: float, at_ends: bool | None) -> tuple[Vehicle, LoadCase]:
    """A body of 9 t whose centre of gravity lies 0.3 m behind the middle, with a share e of its mass at both ends."""
    mass, half, centre = 9000.0, 3.0, 0.1
    vehicle, case = beam(mass, mass * half**2 * ((1.0 - e) / 3.0 + e - centre**2), 2.0 * half)
    loads = (0.5 * mass * (1.0 - centre) + 1.0, 0.5 * mass * (1.0 + centre) + 1.0)
    return vehicle, replace(case, axle_loads_kg=loads, frame_masses=(FrameMass(at_ends=at_ends),))


@pytest.mark.parametrize("e", [0.3, 0.101, 0.099, 0.0, -0.05])
def test_an_end_may_lack_mass_while_masses_are_moved(e):
    """psi is 2 at both ends, has no mean and no slope along a uniform beam, and mean square 1.

    With the shares (1 - e) of the beam, (e - c) / 2 and (e + c) / 2 of the ends, the mean is 2 e, the slope times the
    variance v is 2 c (1 - e), and the modal mass 1 - e + 4 e - (2 e)^2 - (2 c (1 - e))^2 / v.
    """
    vehicle, case = shifted_beam(e, at_ends=True)
    (mode,) = frame_modes(vehicle, case)
    centre = 0.1
    variance = (1.0 - e) / 3.0 + e - centre**2
    slope = 2.0 * centre * (1.0 - e) / variance
    exact = 1.0 - e + 4.0 * e - (2.0 * e) ** 2 - slope**2 * variance
    assert mode.modal_mass == pytest.approx(9000.0 * exact, rel=1e-14)
    for t in (0.0, 0.4, 1.0):
        rise = float(free_beam(np.array(t))) - 2.0 * e - slope * (2.0 * t - 1.0 - centre)
        assert mode.rise(6.0 * t) == pytest.approx(rise, abs=1e-14)


def test_an_end_lacks_no_more_than_a_tenth_of_the_mass():
    few, more = (
        [frame_modes(*shifted_beam(e, at_ends=kind))[0].modal_mass for kind in (True, False)] for e in (-0.09, -0.11)
    )
    assert few[0] != few[1]
    assert more[0] == more[1]


def test_the_kind_of_mass_is_kept_because_the_kinds_differ_where_one_takes_the_place_of_the_other():
    kept = [frame_modes(*shifted_beam(e, at_ends=True))[0].modal_mass for e in (0.10001, 0.09999)]
    chosen = [frame_modes(*shifted_beam(e, at_ends=None))[0].modal_mass for e in (0.10001, 0.09999)]
    assert chosen[0] == kept[0]
    assert kept[1] == pytest.approx(kept[0], rel=5e-5)
    assert abs(chosen[1] / chosen[0] - 1.0) > 0.09
    spread = [frame_modes(*shifted_beam(e, at_ends=False))[0].modal_mass for e in (0.10001, 0.09999)]
    assert spread[1] == chosen[1]
    assert spread[0] == pytest.approx(spread[1], rel=1.1e-5)


def independent_shape(case: LoadCase) -> tuple[object, float]:
    """phi and modal mass of the three-axle truck by quadrature."""
    unsprung = np.array([a.unsprung_mass_kg for a in AXLES])
    support = np.array(case.axle_loads_kg) - unsprung
    x = np.array([a.x_m for a in AXLES])
    cg, mass, inertia = float(support @ x / support.sum()), case.sprung_mass_kg[0], case.pitch_inertia_kg_m2[0]
    ends = (0.0, x[-1])

    length, offset, second = ends[1], cg - 0.5 * ends[1], inertia / mass
    # A uniform beam with end masses: their sum from the inertia, their difference from the centre of gravity.
    ends_share = (second + offset**2 - length**2 / 12.0) / (length**2 / 6.0)
    shares = np.array([0.5 * ends_share - offset / length, 0.5 * ends_share + offset / length])
    assert (shares.min() >= 0.0) == (case is EMPTY)  # both kinds of mass are tried

    def mean(f):
        if case is EMPTY:
            beam = quad(f, *ends, epsabs=1e-12)[0] / length
            return (1.0 - ends_share) * beam + shares @ [f(ends[0]), f(ends[1])]
        return quad(lambda s: f(s) * np.exp(c[0] + c[1] * (s - cg) + c[2] * (s - cg) ** 2), *ends, epsabs=1e-12)[0]

    def missing(trial):
        nonlocal c
        c = trial
        return np.array([mean(lambda s, n=n: (s - cg) ** n) for n in range(3)]) - [1.0, 0.0, second]

    c = np.array([-np.log(length), 0.0, 0.0])
    if case is not EMPTY:
        c = fsolve(missing, c, xtol=1e-13)
    assert np.abs(missing(c)).max() < 1e-10

    def psi(s):
        return free_beam(np.array(s / length))

    heave, pitch = mean(psi), mean(lambda s: psi(s) * (s - cg)) / second

    def phi(s):
        return float(psi(s) - heave - pitch * (s - cg))

    return phi, mass * mean(lambda s: phi(s) ** 2)


@pytest.mark.parametrize("case", [EMPTY, LADEN], ids=["empty", "laden"])
def test_shape_of_a_truck_by_quadrature(case):
    phi, modal_mass = independent_shape(case)
    (mode,) = frame_modes(BENT, case)
    assert mode.modal_mass == pytest.approx(modal_mass, rel=1e-7)
    for x in (0.0, 1.3, 4.2, 5.55, 6.0):
        assert mode.rise(x) == pytest.approx(phi(x), abs=1e-7)


def test_a_declared_shape_keeps_its_bending_alone():
    """A shape with any heave and pitch added is the same mode; a table of psi is psi."""
    x = np.linspace(0.0, 5.55, 30)
    table = free_beam(x / 5.55)
    (beam_mode,) = frame_modes(BENT, EMPTY)
    for extra in (0.0 * x, 3.0 - 0.7 * x):
        body = Body("truck", bending=FrameBending(HZ, RATIO, tuple(x), tuple(table + extra)))
        (mode,) = frame_modes(replace(VEHICLE, bodies=(body,)), EMPTY)
        assert mode.modal_mass == pytest.approx(beam_mode.modal_mass, rel=2e-3)
        assert mode.rise(2.0) == pytest.approx(beam_mode.rise(2.0), abs=5e-3)


def test_mass_that_lies_elsewhere_changes_what_is_taken_out_of_the_shape():
    """Three point masses with the mass, centre and inertia of a uniform beam: sums over them instead of integrals."""
    mass, length = 9000.0, 6.0
    vehicle, case = beam(mass, mass * length**2 / 12.0, length)
    lumps, at = mass * np.array([0.2, 0.5, 0.3]), np.array([0.1, 0.45, 0.9])
    arm = length * (at - 0.5)
    psi = np.array([float(free_beam(t)) for t in at])
    heave, slope = lumps @ psi / mass, lumps @ (psi * arm) / (mass * length**2 / 12.0)
    modal = lumps @ (psi - heave - slope * arm) ** 2
    # A uniform beam has heave and slope 0 and the modal mass m.
    (mode,) = frame_modes(vehicle, replace(case, frame_masses=(FrameMass(heave, slope * 3.0, np.log(modal / mass)),)))
    assert mode.modal_mass == pytest.approx(modal, rel=1e-9)
    for t in (0.0, 0.2, 0.5, 1.0):
        exact = float(free_beam(np.array(t))) - heave - slope * length * (t - 0.5)
        assert mode.rise(length * t) == pytest.approx(exact, abs=1e-9)


def test_mass_that_cannot_lie_between_the_ends_is_a_sentence():
    with pytest.raises(CampaignError, match=r"that no mass between its ends can have; give bending\.shape"):
        frame_modes(*beam(9000.0, 9000.0 * 9.0))


# ------------------------------------------------------------------------------------------------------------- passes


def frames(hz: float = HZ, ratio: float = RATIO) -> FrameLaw:
    turn = 2 * np.pi * hz
    return FrameLaw(jnp.full((2, 1, 1), turn**2), jnp.full((2, 1, 1), 2 * ratio * turn))


LAW = SuspensionLaw(per_axle(STIFFNESS), per_axle(DAMPING), frames=frames())


@pytest.fixture(scope="module")
def oracle() -> list[dict[str, np.ndarray]]:
    phi, mass = independent_shape(EMPTY)
    at_axles, at_points = (np.array([phi(x) for x in places]) for places in ([a.x_m for a in AXLES], POINTS_M))
    bend = Bend(at_axles, at_points, mass, 2 * np.pi * HZ, RATIO)
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    return [Truck(h, bend=bend).histories(times) for h in HEIGHTS_M]


def test_every_channel_against_dop853_at_the_default_step(oracle):
    assert worst_error(simulated_truck(0.00125, law=LAW, vehicle=BENT, heights_m=HEIGHTS_M), oracle) < 1e-4


def test_the_oracle_tells_a_bending_frame_from_a_rigid_one(oracle):
    assert worst_error(simulated_truck(0.00125, heights_m=HEIGHTS_M), oracle) > 0.1
    other = LAW._replace(frames=frames(hz=8.4))
    assert worst_error(simulated_truck(0.00125, law=other, vehicle=BENT, heights_m=HEIGHTS_M), oracle) > 0.02


def test_forward_derivatives_against_central_differences():
    run = truck_model(0.0025, duration_s=0.7, vehicle=BENT)
    weight = np.random.default_rng(5).normal(size=(2, 3, 1))

    def outcome(x: jax.Array) -> jax.Array:
        law = LAW._replace(
            frames=FrameLaw(LAW.frames.stiffness * x[0], LAW.frames.damping * x[1]), stiffness=LAW.stiffness * x[2]
        )
        found = run(law, SPEED_M_S)
        return (found.tire_force * weight).sum() / 1e6 + (found.deflection * weight).sum() * 10.0

    at, step = jnp.ones(3), 1e-6
    forward = np.asarray(jax.jit(jax.jacfwd(outcome))(at))
    plain = jax.jit(outcome)
    central = [(plain(at + step * e) - plain(at - step * e)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(forward, central, rtol=1e-6, atol=1e-6 * np.abs(forward).max())


# ------------------------------------------------------------------------------------------------------ natural modes


def test_natural_modes_of_two_bending_bodies_against_energies_with_constraints(monkeypatch):
    """The hinge moves with both frames.  Apart from the shapes, nothing of the package is used by the other side."""
    axles = (
        Axle("steer", 0, 0.0, 540.0, 1.7e6, 0.0, 0.5, "leaf"),
        Axle("drive", 0, 3.9, 900.0, 2.9e6, 0.0, 0.5, "leaf"),
        Axle("trailer 1", 1, 11.0, 700.0, 2.6e6, 0.0, 0.5, "leaf"),
        Axle("trailer 2", 1, 12.3, 600.0, 2.8e6, 0.0, 0.5, "leaf"),
    )
    bends = (FrameBending(11.0, 0.02), FrameBending(7.0, 0.03))
    bodies = (Body("tractor", bending=bends[0]), Body("trailer", 4.4, 1.2, bends[1]))
    vehicle = Vehicle("bent", bodies, axles)
    first = LoadCase("empty", (4800, 4212, 4200, 4100), (6000, 8572), (8e3, 60e3), (1.0, 1.6))
    laden = LoadCase("laden", (4800, 8640, 8200, 8100), (6000, 21000), (8.2e3, 180e3), (1.0, 1.9))
    k, c = np.array([4e5, 9e5, 1.1e6, 1.0e6]), np.array([1e4, 2e4, 1.2e4, 1.3e4])
    truck = IndependentTruck(
        body=(0, 0, 1, 1),
        x_m=tuple(a.x_m for a in axles),
        unsprung_kg=tuple(a.unsprung_mass_kg for a in axles),
        radius_m=(0.5,) * 4,
        tire_N_per_m=tuple(a.tire_stiffness_N_per_m for a in axles),
        tire_N_s_per_m=(0.0,) * 4,
        stiffness=tuple(k),
        damping=tuple(c),
        load_cases={
            v.name: (v.axle_loads_kg, v.sprung_mass_kg, v.pitch_inertia_kg_m2, v.cg_height_m) for v in (first, laden)
        },
        suspension=("leaf",) * 4,
        hitch=((4.4, 1.2),),
        bending=tuple(Bending(b.frequency_hz, b.damping_ratio, (0.0, 1.0)) for b in bends),
    )

    def shape(_, body, mass, inertia, cg):
        case = first if mass == first.sprung_mass_kg[body] and inertia == first.pitch_inertia_kg_m2[body] else laden
        mode = frame_modes(vehicle, case)[body]
        return mode.rise, mode.modal_mass

    monkeypatch.setattr(Equations, "_shape", staticmethod(shape))
    e = Equations(truck, "laden")
    springs = e.push @ e.through @ np.diag(e.suspension) @ e.extension
    square = np.linalg.eigvals(e.stiffness + springs + e.lift @ np.diag(truck.tire_N_per_m) @ e.wheel)
    square = np.sort(square.real)
    assert abs(square[0]) < 1e-6 * square[-1]  # fore and aft nothing holds it
    modes = natural_modes(vehicle, laden, k, c, first=first)
    np.testing.assert_allclose(modes.frequency_hz, np.sqrt(square[1:]) / (2 * np.pi), rtol=1e-8)
    assert {"bending tractor", "bending trailer"} <= set(modes.coordinates)

    # Drawn along its frame, the tractor ends where the trailer begins.
    def rise(body: int) -> np.ndarray:
        bent = np.array([np.interp(4.4, modes.frame_x_m[body], row) for row in modes.frame_rise[body].T])
        _, heave, pitch = modes.body_motion[body]
        return heave - pitch * (4.4 - modes.cg_x_m[body]) + bent

    np.testing.assert_allclose(rise(0), rise(1), atol=1e-9)
    stiffer = natural_modes(vehicle, laden, k, c, first=first, bending={"trailer": (9.0, 0.03)})
    assert np.abs(stiffer.frequency_hz / modes.frequency_hz - 1.0).max() > 0.02
