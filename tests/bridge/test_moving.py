"""Moving forces against closed forms, and sprung masses on a beam against published and own integrations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from sysid.bridge.beam import ContinuousBeam
from sysid.bridge.moving import (
    TOLERANCE,
    Alike,
    Crossing,
    alike,
    coupled,
    deck_motion,
    dynamic_effects,
    effect_times,
    static_effects,
)
from sysid.errors import DataRejectedError

EI, MASS, LENGTH = 4.0e10, 9000.0, 25.0


def simple(modes: int = 8, damping: float = 0.0, stiffness: float = EI, mass: float = MASS, length: float = LENGTH):
    beam = ContinuousBeam([length], [stiffness], [mass], ["pinned", "pinned"])
    return beam.bridge("beam", [0.0, 0.5 * length], modes, damping)


def steady(speed: float, axle_x: list[float], until_m: float, interval_s: float = 0.002) -> Crossing:
    count = int(np.ceil((until_m + max(axle_x)) / speed / interval_s)) + 1
    return Crossing(speed * interval_s * np.arange(count)[:, None] - np.array(axle_x), interval_s)


def named(bridge, word: str) -> int:
    return next(k for k, line in enumerate(bridge.lines) if line.name.startswith(word))


@pytest.mark.parametrize("speed", [11.0, 25.0, 44.0])
def test_a_constant_force_on_a_simple_beam(speed: float):
    """Sum of modes, undamped: q = 2 P / (M (w^2 - W^2)) (sin W t - W / w sin w t), W = n pi v / L (Fryba, 1999)."""
    force, bridge = 1.0e5, simple()
    crossing = steady(speed, [0.0], LENGTH)
    t = crossing.interval_s * np.arange(len(crossing.place_m))
    motion = deck_motion(bridge.modes, crossing)
    q = motion.amplitudes(np.full((t.size, 1, 1), force))
    found = (q[:, :, 0] * bridge.modes.shape.at(np.array(0.5 * LENGTH))).sum(axis=1)
    exact = np.zeros(t.size)
    for n in range(1, 9):
        omega, wave = (n * np.pi / LENGTH) ** 2 * np.sqrt(EI / MASS), n * np.pi * speed / LENGTH
        size = 2 * force / (MASS * LENGTH * (omega**2 - wave**2)) * np.sin(0.5 * n * np.pi)
        exact += size * (np.sin(wave * t) - wave / omega * np.sin(omega * t))
    on = t <= LENGTH / speed
    assert np.abs(found - exact)[on].max() < 1e-6 * np.abs(exact).max()
    assert np.abs(found - 1.00001 * exact)[on].max() > 1e-6 * np.abs(exact).max()


def test_constant_forces_on_a_continuous_beam():
    """Two axles over two spans with damping: the modes by their equations, and the equations of motion by DOP853."""
    span, speed, damping = 20.0, 20.0, 0.02
    beam = ContinuousBeam([span, span], [EI, EI], [MASS, MASS], ["pinned"] * 3)
    bridge = beam.bridge("beam", [10.0], 4, damping)
    axle_x, force = [0.0, 3.7], np.array([9.0e4, 6.0e4])
    crossing = steady(speed, axle_x, 2 * span)
    t = crossing.interval_s * np.arange(len(crossing.place_m))
    b = 3.9266023120479  # tan b = tanh b

    def symmetric(x: np.ndarray, root: float) -> np.ndarray:
        y = root * np.minimum(x, 2 * span - x) / span
        return np.sin(y) / np.sin(root) - np.sinh(y) / np.sinh(root)

    shapes = [
        lambda x: np.sin(np.pi * x / span),
        lambda x: symmetric(x, b),
        lambda x: np.sin(2 * np.pi * x / span),
        lambda x: symmetric(x, 7.0685827456287),
    ]
    roots = np.array([np.pi, b, 2 * np.pi, 7.0685827456287])
    omega = (roots / span) ** 2 * np.sqrt(EI / MASS)
    point = np.polynomial.legendre.leggauss(60)
    x, w = 0.5 * span * (1 + point[0]), 0.5 * span * point[1]
    mass = np.array([2 * MASS * (w * f(x) ** 2).sum() for f in shapes])

    def rate(at: float, y: np.ndarray) -> np.ndarray:
        place = speed * at - np.array(axle_x)
        on = (place > 0) & (place < 2 * span)
        push = np.array([(f(place) * force * on).sum() for f in shapes]) / mass
        return np.concatenate([y[4:], push - 2 * damping * omega * y[4:] - omega**2 * y[:4]])

    exact = solve_ivp(rate, (0, t[-1]), np.zeros(8), "DOP853", t, rtol=1e-10, atol=1e-14, max_step=0.01).y[:4]
    wanted = sum(q * f(np.array(10.0)) for q, f in zip(exact, shapes, strict=True))
    q = deck_motion(bridge.modes, crossing).amplitudes(np.tile(force[None, :, None], (t.size, 1, 1)))
    found = (q[:, :, 0] * bridge.modes.shape.at(np.array(10.0))).sum(axis=1)
    assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()
    assert np.abs(found - 1.000003 * wanted).max() > 1e-6 * np.abs(wanted).max()


def test_mode_acceleration_of_moment_and_shear():
    """Eight modes give what four hundred terms of the closed form do; without the static part they are off by far."""
    force, speed, bridge = 1.0e5, 25.0, simple()
    crossing = steady(speed, [0.0], LENGTH)
    times, motion = effect_times(bridge, crossing), deck_motion(bridge.modes, crossing)
    forces = np.full((len(crossing.place_m), 1, 1), force)
    found = dynamic_effects(times, motion, forces)[:, :, 0]
    t = crossing.interval_s * (times.sample + times.share)
    n = np.arange(1, 2001)[:, None]
    omega, wave = (n * np.pi / LENGTH) ** 2 * np.sqrt(EI / MASS), n * np.pi * speed / LENGTH
    q = 2 * force / (MASS * LENGTH * (omega**2 - wave**2)) * (np.sin(wave * t) - wave / omega * np.sin(omega * t))
    moment = (EI * (n * np.pi / LENGTH) ** 2 * np.sin(0.5 * n * np.pi) * q).sum(axis=0)
    scale = np.abs(moment).max()
    middle = named(bridge, "moment")
    assert np.abs(found[middle] - moment).max() < 2e-3 * scale
    modal = (bridge.modes.effects[middle] * times.between(motion.amplitudes(forces)[:, :, 0])).sum(axis=1)
    assert np.abs(modal - moment).max() > 2e-2 * scale


def test_shear_either_side_of_an_axle():
    """At mid-span of a simple beam an axle has P / 2 on its right and -P / 2 on its left, between samples too."""
    bridge = simple()
    crossing = steady(23.0, [0.0, 4.0], LENGTH, 0.0137)
    times = effect_times(bridge, crossing)
    shear = static_effects(times, np.array([[[1e5], [0.0]]]))[named(bridge, "shear at 12.5"), :, 0]
    assert shear.max() == pytest.approx(0.5e5, rel=1e-5)
    assert shear.min() == pytest.approx(-0.5e5, rel=1e-5)
    coarse = np.stack([line.curve.at(crossing.place_m) for line in bridge.lines])[named(bridge, "shear at 12.5")]
    assert np.abs(coarse[:, 0]).max() < 0.499


class SprungMass:
    """A mass on spring and damper over a road, by the exact answer to an input that is straight between samples."""

    def __init__(self, mass: float, stiffness: float, damping: float, height: np.ndarray, interval_s: float):
        self.m, self.k, self.c, self.height, self.h = mass, stiffness, damping, height, interval_s

    def forces(self, deck_m: np.ndarray) -> np.ndarray:
        road = self.height[:, None, None] - deck_m + np.zeros((self.height.size, 1, 1))
        u = road[:, 0, 0]
        rate = np.gradient(u, self.h)
        a = [[0.0, 1.0], [-self.k / self.m, -self.c / self.m]]
        b = [[0.0, 0.0], [self.k / self.m, self.c / self.m]]
        t = self.h * np.arange(u.size)
        _, _, x = lsim((a, b, np.eye(2), np.zeros((2, 2))), np.stack([u, rate], axis=1), t)
        force = self.m * 9.81 + self.k * (u - x[:, 0]) + self.c * (rate - x[:, 1])
        return force[:, None, None]


#: Length, EI, mass, speed, damper, ramp, acceleration and the published or own peak at mid-span [mm].
SPRUNG = {
    "VBI-2D": ((25.0, 3.5e10 * 1.3901, 18358.0), 25.0, 0.0, 0.0, 0.0, 0.41855),
    "VBI-2D, ramp": ((25.0, 3.5e10 * 1.3901, 18358.0), 25.0, 0.0, 0.010, 0.0, 0.46721),
    "VBI-2D, damper": ((25.0, 3.5e10 * 1.3901, 18358.0), 25.0, 4e5, 0.010, 0.0, 0.46260),
    "VBI-2D, braking": ((25.0, 3.5e10 * 1.3901, 18358.0), 25.0, 4e5, 0.010, 10.0, 0.46912),
    "Biggs and Yang": ((25.0, 2.87e9 * 2.9, 2303.0), 100 / 3.6, 0.0, 0.0, 0.0, 2.4073),
}


def sprung_on_beam(name: str, interval_s: float = 0.001, deck_felt: float = 1.0, mass_kg: float = 5750.0):
    """Motion of the beam, forces of a sprung mass on 1,595 kN/m that crosses, and the shapes at mid-span."""
    (length, stiffness, mass), speed, damper, ramp, acceleration, _ = SPRUNG[name]
    bridge = simple(20, 0.0, stiffness, mass, length)
    last = (np.sqrt(speed**2 + 2 * acceleration * length) - speed) / acceleration if acceleration else length / speed
    t = np.arange(0.0, last + interval_s, interval_s)
    place = speed * t + 0.5 * acceleration * t**2
    height = np.interp(place, [length / 3, length / 2], [0.0, ramp])
    vehicle = SprungMass(mass_kg, 1595e3, damper, height, interval_s)
    motion = deck_motion(bridge.modes, Crossing(place[:, None], interval_s))
    return motion, lambda deck: vehicle.forces(deck_felt * deck), bridge.modes.shape.at(np.array(0.5 * length))


def sprung_peak_mm(name: str, deck_felt: float = 1.0, begun: Alike | None = None) -> float:
    """Largest deflection at mid-span."""
    motion, forces, middle = sprung_on_beam(name, deck_felt=deck_felt)
    found = coupled(motion, forces, 5750.0 * 9.81, begun)
    return 1e3 * float((motion.amplitudes(found.force_N)[:, :, 0] @ middle).max())


@pytest.mark.parametrize("name", SPRUNG)
def test_sprung_mass_on_a_beam(name: str):
    """D. Cantero, VBI-2D, Verification (SoftwareX 2023): ramp of 10 mm from L / 3 to L / 2, damper, acceleration."""
    assert sprung_peak_mm(name) == pytest.approx(SPRUNG[name][-1], rel=2e-3)


def test_a_vehicle_that_does_not_feel_the_deck_is_seen():
    assert sprung_peak_mm("Biggs and Yang", deck_felt=0.0) != pytest.approx(SPRUNG["Biggs and Yang"][-1], rel=2e-3)


def test_where_the_rounds_begin_changes_their_number_and_not_their_end():
    """From the deck under a mass a fiftieth lighter and from one that none ever met: one peak; the first is nearer."""
    name = "Biggs and Yang"
    motion, forces, _ = sprung_on_beam(name)
    alone = coupled(motion, forces, 5750.0 * 9.81)
    own = alike(motion, forces, alone)
    near = own._replace(deck_m=0.98 * own.deck_m)
    assert coupled(motion, forces, 5750.0 * 9.81, near).rounds < alone.rounds
    for begun in (near, near._replace(deck_m=-5.0 * near.deck_m)):
        assert sprung_peak_mm(name, begun=begun) == pytest.approx(SPRUNG[name][-1], rel=2e-3)


def test_others_need_one_round_and_no_rigid_deck():
    """Two masses 1 % apart show a third one between them; forces are those of its own rounds, to the tolerance.

    With a gain that is too small a deck that is not its own would be taken.
    """
    limit = TOLERANCE * 5750.0 * 9.81
    motion, lighter, _ = sprung_on_beam("Biggs and Yang", mass_kg=5720.0)
    heavier, between = (sprung_on_beam("Biggs and Yang", mass_kg=m)[1] for m in (5780.0, 5755.0))

    def both(deck):
        return np.concatenate([f(np.broadcast_to(deck, (*deck.shape[:2], 2))[:, :, k : k + 1])
                               for k, f in enumerate((lighter, heavier))], axis=2)  # fmt: skip

    begun = alike(motion, both, coupled(motion, both, 5750.0 * 9.81))
    alone, after = (coupled(motion, between, 5750.0 * 9.81, of) for of in (None, begun))
    assert after.rounds == 1 < alone.rounds
    assert np.abs(after.force_N - alone.force_N).max() < limit
    assert np.abs(after.rolling_N - alone.rolling_N).max() < limit
    other = begun._replace(deck_m=1.2 * begun.deck_m)
    assert coupled(motion, between, 5750.0 * 9.81, other).rounds > 1
    wrong = coupled(motion, between, 5750.0 * 9.81, other._replace(gain_N_m=0.0))
    assert np.abs(wrong.force_N - alone.force_N).max() > limit


def test_vehicles_that_never_agree_with_the_deck_are_refused():
    bridge = simple(4)
    crossing = steady(25.0, [0.0], LENGTH)
    motion = deck_motion(bridge.modes, crossing)
    random = np.random.default_rng(1)
    with pytest.raises(DataRejectedError, match="do not come to one motion"):
        coupled(motion, lambda deck: 1e5 * random.random((len(crossing.place_m), 1, 1)), 1e5)
