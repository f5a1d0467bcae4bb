"""Force balance against bodies whose answer to their axles is written down here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.balance import balance_forces, disagreement
from sysid.balance.laws import damper_shape, friction_state
from sysid.balance.motion import stretches_of, with_noise_and_gains
from sysid.campaign.records import Acquisition, BumpRun, Campaign, Channel, Log, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.vehicle_model.assembly import assemble

STEP, COUNT, RADIUS = 0.005, 6000, 0.5
PLACES, UNSPRUNG, LOADS = np.array([0.0, 4.0, 5.4]), 600.0, np.array([5000.0, 6000.0, 5500.0])
K, C = np.array([3.2e5, 6.5e5, 5.8e5]), np.array([1.1e4, 1.6e4, 1.3e4])
MASS, INERTIA = float(LOADS.sum() - 3 * UNSPRUNG), 3.2e4


def truck(law: str | None = None) -> tuple[Vehicle, LoadCase]:
    """The centre of gravity at wheel height: forces along the road turn nothing."""
    axles = tuple(
        Axle(f"axle {i}", 0, float(x), UNSPRUNG, 2.5e6, 3e3, RADIUS, "leaf", suspension_law=law)
        for i, x in enumerate(PLACES)
    )
    case = LoadCase("only", tuple(LOADS.tolist()), (MASS,), (INERTIA,), (RADIUS,))
    return Vehicle("truck", (Body("body"),), axles), case


def motion(seed: int = 1, hold_s: float | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deflections (3, n), accelerations of axles and of the frame above them, for random axle motion.

    Newton's law of the body about its centre of gravity, solved at every frequency of a periodic record. With `hold_s`
    wheels hold the speed: F = -(M / tau) (x' + r theta') acts on the road, M x'' = F, and F r turns the body.
    """
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * np.fft.rfftfreq(COUNT, STEP)
    hz = omega / (2 * np.pi)
    # As of a road (height as 1 / f), with a hump at wheel hop.
    hop = 1.0 + 2.0 * np.exp(-(((hz - 10.0) / 2.0) ** 2))
    size = np.where((hz > 0.4) & (hz < 22.0), hop / np.maximum(hz, 0.4), 0.0)
    axle = 2.0 * size * (rng.normal(size=(3, hz.size)) + 1j * rng.normal(size=(3, hz.size)))
    carried = LOADS - UNSPRUNG
    arm = PLACES - float(carried @ PLACES / carried.sum())
    body = np.zeros((2, hz.size), complex)
    for f, w in enumerate(omega):
        dynamic = K + 1j * w * C
        rise = np.stack([np.ones(3), -arm])
        matrix = -(w**2) * np.diag([MASS, INERTIA]) + (rise * dynamic) @ rise.T
        if hold_s is not None and w > 0.0:
            h = 1j * w / hold_s
            matrix[1, 1] -= LOADS.sum() * RADIUS**2 * w**2 * h / (h - w**2)
        body[:, f] = np.linalg.solve(matrix, rise @ (dynamic * axle[:, f]))
    frame = body[0] - np.outer(arm, body[1])
    back = [np.fft.irfft(s, COUNT, axis=1) for s in (frame - axle, -(omega**2) * axle, -(omega**2) * frame)]
    return back[0], back[1], back[2]


def campaign(
    noise: float = 1.0,
    law: str | None = None,
    gain: float = 1.0,
    lost: str = "",
    seed: int = 1,
    hold_s: float | None = None,
) -> Campaign:
    vehicle, case = truck(law)
    rng = np.random.default_rng(seed + 100)
    channels = []
    for kind, values, sd in zip(("q", "a", "b"), motion(seed, hold_s), (3e-4 * noise, 0.2, 0.15), strict=True):
        for i in range(3):
            sensor = {
                "q": Sensor(f"q{i}", "suspension_deflection", "m", axle=i),
                "a": Sensor(f"a{i}", "axle_acceleration", "m/s^2", axle=i),
                "b": Sensor(f"b{i}", "body_acceleration", "m/s^2", body=0, x_m=float(PLACES[i])),
            }[kind]
            shown = values[i] * (gain if sensor.column == "a1" else 1.0) + sd * rng.normal(size=COUNT)
            if not lost or not sensor.column.startswith(tuple(lost)):
                channels.append(Channel(sensor, STEP * np.arange(COUNT), shown, np.zeros(COUNT, np.int8)))
    run = BumpRun("drive", "only", 15.0, 1, Log("drive.csv", STEP, tuple(channels)))
    return Campaign(
        "drawn", "", Path(), Path("campaign.toml"), vehicle, {"only": case}, Acquisition(STEP, None), (), (run,), {},
        (), {},
    )  # fmt: skip


def least_squares(given: Campaign) -> np.ndarray:
    """k by the regression that the noise of deflections attenuates: body forces on measured deflections and rates."""
    of = {c.sensor.column: c.value for c in given.bump_runs[0].log.channels}
    carried = LOADS - UNSPRUNG
    arm = PLACES - float(carried @ PLACES / carried.sum())
    rise = np.stack([np.ones(3), -arm], axis=1)
    body = np.linalg.lstsq(rise, np.array([of[f"b{i}"] for i in range(3)]), rcond=None)[0]
    hz = np.fft.rfftfreq(COUNT, STEP)
    band = (hz > 0.7) & (hz < 15.0)
    q = np.fft.rfft([of[f"q{i}"] for i in range(3)], axis=1)[:, band]
    parts = (q, 2j * np.pi * hz[band] * q)
    columns = [np.outer(r, x).ravel() for part in parts for r, x in zip(rise, part, strict=True)]
    target = -(np.diag([MASS, INERTIA]) @ np.fft.rfft(body, axis=1)[:, band]).ravel()
    design = np.stack(columns, axis=1)
    stacked = np.concatenate([design.real, design.imag]), np.concatenate([target.real, target.imag])
    return np.linalg.lstsq(*stacked, rcond=None)[0][:3]


def test_stiffness_and_damping_come_back_with_their_intervals():
    found = balance_forces(campaign())
    assert found.converged
    k, c = ([e for e in found.estimates if e.quantity == q] for q in ("stiffness", "damping"))
    assert [e.value for e in k] == pytest.approx(K, rel=0.01)
    assert [e.value for e in c] == pytest.approx(C, rel=0.03)
    assert all(e.low < t < e.high for e, t in zip((*k, *c), (*K, *C), strict=True))
    assert all(e.determined and e.high < 1.12 * e.low for e in (*k, *c))
    # No law but linear ones is there.
    assert all(abs(law.value) < 4.0 * law.sd for law in found.laws if law.quantity == "friction_share")


@pytest.mark.parametrize(("driven_at", "right"), [("road", True), (None, False)])
def test_wheels_that_hold_the_speed_turn_the_body(driven_at, right):
    given = campaign(hold_s=0.05)
    found = balance_forces(replace(given, vehicle=replace(given.vehicle, driven_at=driven_at)))
    k = [e.value for e in found.estimates if e.quantity == "stiffness"]
    assert (k == pytest.approx(K, rel=0.01)) == right


def test_noise_of_deflections_does_not_pull_stiffness_down():
    """Twenty times the usual noise: the regression loses several per cent of k, the likelihood keeps it."""
    given = campaign(noise=20.0, law="linear")
    assert np.min(least_squares(given) / K) < 0.95
    found = [e.value for e in balance_forces(given).estimates if e.quantity == "stiffness"]
    assert found == pytest.approx(K, rel=0.03)


def test_noise_and_gain_of_a_sensor_are_found_by_the_others():
    """A gain 2 % off is two standard deviations of its prior, and these records find most of it."""
    given = campaign(gain=1.02)
    matrices = assemble(given.vehicle, given.load_cases["only"])
    (stretch,), gains = with_noise_and_gains(stretches_of(given.bump_runs[0].log, matrices))
    assert stretch.noise[:3] == pytest.approx(3e-4, rel=0.08)
    assert stretch.noise[6:] == pytest.approx(0.15, rel=0.15)
    relative = gains.value - gains.value.mean()
    assert relative[stretch.columns.index("a1")] == pytest.approx(0.02 * 8 / 9, abs=0.006)


def test_fast_logs_lose_what_is_above_the_band_and_nothing_of_the_band():
    given = campaign()
    time = 0.001 * np.arange(20_000)
    # At steps of 5 ms, 230 Hz looks as 30 Hz.
    below, above = np.sin(2 * np.pi * 12.0 * time), np.sin(2 * np.pi * 230.0 * time)
    quiet = np.zeros(time.size, np.int8)
    channels = given.bump_runs[0].log.channels
    log = Log("fast.csv", 0.001, tuple(Channel(c.sensor, time, below + above, quiet) for c in channels))
    (stretch,) = stretches_of(log, assemble(given.vehicle, given.load_cases["only"]))
    assert stretch.step_s == pytest.approx(0.005)
    inside = slice(100, stretch.count - 100)
    picked = (below + above)[::5][: stretch.count]
    assert np.max(np.abs(stretch.readings[0] - below[::5][: stretch.count])[inside]) < 0.005
    assert np.max(np.abs(picked - below[::5][: stretch.count])[inside]) > 0.9


def test_a_log_without_deflections_and_axles_tells_nothing():
    found = balance_forces(campaign(lost="qa"))
    assert found.estimates == ()
    assert "deflection" in found.sentences[0]


def test_beams_and_rockers_are_refused():
    given = campaign()
    bent = replace(given.vehicle, bodies=(replace(given.vehicle.bodies[0], bending=object()),))
    found = balance_forces(replace(given, vehicle=bent))
    assert found.estimates == ()
    assert "rigid" in found.sentences[0]


def test_friction_slides_like_dahls_element_step_by_step():
    path = 4e-3 * np.sin(np.linspace(0.0, 9.0, 700)) + 1e-3 * np.sin(np.linspace(0.0, 80.0, 700))
    state, exact = 0.0, [0.0]
    for step in np.diff(path):
        state = np.sign(step) + (state - np.sign(step)) * np.exp(-abs(step) / 1e-3)
        exact.append(state)
    assert friction_state(path, 1e-3) == pytest.approx(np.array(exact), abs=1e-12)


def test_a_saturating_damper_has_its_coefficient_at_half_a_metre_per_second():
    assert damper_shape(0.5, 0.8) == pytest.approx(0.5)
    assert damper_shape(np.array([-2.0]), 1.0) == pytest.approx(-2.0 / 3.0 * 1.5)


class Fitted:
    """A fit as far as the comparison reads it."""

    class _Of:
        def __init__(self, quantity, axle, value):
            self.quantity, self.axle, self.load_case, self.value, self.sd = quantity, axle, None, value, 0.01 * value

    def __init__(self, factor):
        self.parameters = [self._Of("stiffness", i, factor * k) for i, k in enumerate(K)]


def test_disagreement_counts_in_standard_deviations_of_both():
    balance = balance_forces(campaign())
    near, far = (disagreement(balance, Fitted(f)) for f in (1.0, 1.2))
    assert [d.axle for d in near] == [0, 1, 2]
    assert all(abs(d.in_sd) < 2.0 for d in near)
    e = next(e for e in balance.estimates if e.name == "k_1")
    assert far[0].in_sd == pytest.approx(np.log(e.value / (1.2 * K[0])) / np.hypot(e.log_sd, 0.01))
    assert all(d.in_sd < -4.0 for d in far)
