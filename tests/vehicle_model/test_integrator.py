"""The fixed-step integrator against DOP853 on equations written out here for one rigid body on three axles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigid_truck import AXLES, DAMPING, EMPTY, EXPONENT, FILTER, STIFFNESS, VEHICLE
from scipy import signal
from scipy.integrate import solve_ivp

from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import effective_road, road_input, tire_law
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.simulation import (
    SPEED_HOLD_S,
    Motion,
    SensorLayout,
    lane_matrices,
    simulate_histories,
    simulate_sensors,
    stage_times,
)
from sysid.vehicle_model.suspension import SuspensionLaw

SPEED_M_S = 8.0  # with steps of 1.25 ms every wheel passes exactly over the 10 mm stations
START_S = 0.25
DURATION_S = 1.5
#: A bump that every axle leaves, and one that none leaves.
HEIGHTS_M = (0.07, 0.006)
WIDTH_M = 0.22
POINTS_M = (0.3, 5.0)
#: Size of the footprint map's departure from a flat road.
ALPHA = 0.15
OUTPUT_S = 0.005
FINE_S = 0.000125

X = np.array([a.x_m for a in AXLES])
UNSPRUNG = np.array([a.unsprung_mass_kg for a in AXLES])
TIRE_STIFFNESS = np.array([a.tire_stiffness_N_per_m for a in AXLES])
TIRE_DAMPING = np.array([a.tire_damping_N_s_per_m for a in AXLES])
LOAD = np.array(EMPTY.axle_loads_kg) * 9.81


def road(s: np.ndarray, order: int = 0) -> np.ndarray:
    """Gaussian bump of unit height and its slope."""
    t = (s - 0.6) / WIDTH_M
    return np.exp(-(t**2)) * (-2 * t / WIDTH_M if order else 1.0)


@dataclass(frozen=True)
class Truck:
    """Quantities of the hand-written equations: statics, tire law, and the coupled mass of travel and pitch."""

    height_m: float

    def __post_init__(self) -> None:
        preload = LOAD - UNSPRUNG * 9.81
        cg_x = float(preload @ X / preload.sum())
        below = np.array([a.tire_radius_m for a in AXLES]) - EMPTY.cg_height_m[0]
        coupling = float(-(UNSPRUNG * below).sum())
        inertia = EMPTY.pitch_inertia_kg_m2[0] + float((UNSPRUNG * below**2).sum())
        total = EMPTY.sprung_mass_kg[0] + UNSPRUNG.sum()
        self.__dict__.update(
            cg_x=cg_x,
            below=below,
            tilt=float((preload * below).sum()),
            mass=np.array([[total, coupling], [coupling, inertia]]),
            total=total,
            rest=EXPONENT * LOAD / TIRE_STIFFNESS,
        )

    def signals(self, t: float, y: np.ndarray) -> dict[str, np.ndarray]:
        """Accelerations, forces and deflections in state y = (xi, z, theta, z_1..3, and rates)."""
        (xi, z, theta), axle = y[:3], y[3:6]
        (xi_rate, z_rate, theta_rate), axle_rate = y[6:9], y[9:12]
        arm = X - self.cg_x
        extension = z - theta * arm - axle
        pull = STIFFNESS * extension + DAMPING * (z_rate - theta_rate * arm - axle_rate)
        s = SPEED_M_S * (t - START_S) - X + xi - theta * self.below
        slope = self.height_m * road(s, 1)
        speed = SPEED_M_S + xi_rate - theta_rate * self.below
        v, v_rate = self.height_m * road(s) - axle, slope * speed - axle_rate
        a, a_slope = ALPHA * road(s), ALPHA * road(s, 1)
        # Clear of the road, above first contact at v = -rest, the map stays what it was there.
        w = np.maximum(v, -self.rest)
        w_rate = np.where(v > -self.rest, v_rate, 0.0)
        e = self.rest + v + a * w + 2.0 * a * w**2 - 5.0 * a * w**3
        e_rate = v_rate + w_rate * (a + 4.0 * a * w - 15.0 * a * w**2) + speed * a_slope * (w + 2.0 * w**2 - 5.0 * w**3)
        x = e / self.rest
        grip = np.maximum(x, 0.0) * np.sqrt(1.1 / (np.maximum(x, 0.0) + 0.1))  # no damping off the ground
        force = LOAD * np.sign(x) * np.abs(x) ** EXPONENT + TIRE_DAMPING * grip * e_rate
        vertical = np.maximum(force, 0.0)
        push = vertical * (-slope + 3.0 * slope * w)
        right = [
            push.sum() - self.total / SPEED_HOLD_S * xi_rate,
            (pull * arm).sum() - (push * self.below).sum() - self.tilt * theta,
        ]
        xi_acceleration, theta_acceleration = np.linalg.solve(self.mass, right)
        z_acceleration = -pull.sum() / EMPTY.sprung_mass_kg[0]
        return {
            "body": np.array([xi_acceleration, z_acceleration, theta_acceleration]),
            "axle_acceleration": (vertical - LOAD + pull) / UNSPRUNG,
            "body_acceleration": z_acceleration - theta_acceleration * (np.array(POINTS_M) - self.cg_x),
            "tire_force": vertical,
            "horizontal_force": push,
            "deflection": extension,
        }

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        found = self.signals(t, y)
        return np.concatenate([y[6:], found["body"], found["axle_acceleration"]])


QUANTITIES = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "horizontal_force")


@pytest.fixture(scope="session")
def oracle() -> list[dict[str, np.ndarray]]:
    """Histories (n, channels) of both bumps every 0.125 ms."""
    found = []
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    for height in HEIGHTS_M:
        truck = Truck(height)
        solution = solve_ivp(
            truck.rates,
            (0.0, times[-1]),
            np.zeros(12),
            method="DOP853",
            t_eval=times,
            rtol=1e-11,
            atol=1e-13,
            max_step=0.005,
        )
        rows = [truck.signals(t, y) for t, y in zip(times, solution.y.T, strict=True)]
        found.append({q: np.array([r[q] for r in rows]) for q in QUANTITIES})
    return found


def model(step_s: float, *, filtered: bool = False, speed_m_s: float = SPEED_M_S):
    """The package's own simulation of both bumps, every 5 ms with steps of `step_s`."""
    matrices = assemble(VEHICLE, EMPTY)
    lanes = lane_matrices([matrices] * 2, [(0, x) for x in POINTS_M])
    station = np.arange(-250, 300) * 0.01
    rises = np.tile(road(station), (2, 3, 1)) * np.array(HEIGHTS_M)[:, None, None]
    shape = np.tile(road(station), (2, 3, 1))
    stretch = ALPHA * np.stack([shape, 2.0 * shape, -5.0 * shape, 0.0 * shape])
    slopes = np.tile(road(station, 1), (2, 3, 1)) * np.array(HEIGHTS_M)[:, None, None]
    drag = np.stack([-slopes, 3.0 * slopes, 0.0 * slopes])
    table = effective_road(station, rises, stretch, drag)
    samples, substeps = round(DURATION_S / OUTPUT_S), round(OUTPUT_S / step_s)

    @jax.jit
    def run(speed):
        def per_axle(values):
            return jnp.asarray(np.tile(values[:, None], (2, 1, 1)))

        tire = tire_law(
            per_axle(TIRE_STIFFNESS), per_axle(TIRE_DAMPING), EXPONENT, lanes.static_load, lanes.static_load
        )
        motion = Motion(jnp.full((2, 1), speed), jnp.full((2, 1), START_S))
        times = stage_times(samples, OUTPUT_S, substeps)[:, None, None, None]
        inputs = road_input(table, motion.speed[:, None] * (times - START_S) - X[:, None])
        laws = (SuspensionLaw(per_axle(STIFFNESS), per_axle(DAMPING)), tire, motion, inputs)
        options = {"interval_s": OUTPUT_S, "substeps": substeps}
        if filtered:
            layout = SensorLayout((0, 1, 2), (0, 1, 2))
            return simulate_sensors(lanes, *laws, layout, discretise(FILTER, step_s), **options)
        return simulate_histories(lanes, *laws, **options)

    return run(speed_m_s)


@pytest.fixture(scope="session")
def histories() -> dict[float, object]:
    """Histories at steps of 2.5, 1.25 and 0.625 ms."""
    return {h: model(h) for h in (0.0025, 0.00125, 0.000625)}


def relative_rms(ours: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Per channel RMS(ours - exact) / RMS(exact - its static value)."""
    return np.sqrt(np.mean((ours - exact) ** 2, axis=0) / np.mean((exact - exact[0]) ** 2, axis=0))


def worst(histories, oracle, lane: int) -> dict[str, float]:
    """Largest error of any axle or point, by quantity."""
    every = round(OUTPUT_S / FINE_S)
    return {
        q: relative_rms(np.asarray(getattr(histories, q))[:, lane, :, 0], oracle[lane][q][::every]).max()
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


def test_fourth_order_where_nothing_lifts_off(histories):
    """Errors of successive halvings fall by 2^4."""
    for q in QUANTITIES:
        values = [np.asarray(getattr(histories[h], q))[:, 1, :, 0] for h in sorted(histories, reverse=True)]
        coarse, fine = (np.sqrt(((a - b) ** 2).sum()) for a, b in pairwise(values))
        assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.1)


def test_sensors_see_the_filtered_histories(oracle):
    """Through the anti-alias filter, at the step of a 200 Hz campaign: against a fine simulation of the filter."""
    ours = np.asarray(model(0.0025, filtered=True))[..., 0]
    b, a = signal.butter(FILTER.order, 2 * np.pi * FILTER.cutoff_hz, analog=True)
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    every = round(OUTPUT_S / FINE_S)
    for lane in range(2):
        raw = np.concatenate([oracle[lane][q] for q in QUANTITIES[:3]], axis=1)
        exact = np.stack([signal.lsim((b, a), column, times)[1][::every] for column in raw.T], axis=1)
        error = relative_rms(ours[:, lane], exact)
        assert error.max() < (3e-3, 5e-5)[lane], error


def test_speeds_a_hair_beside_the_nominal_one_give_the_same(histories):
    """At 8 m/s every look-up falls on a station; the neighbouring floating-point speed falls beside it."""
    beside = model(0.00125, speed_m_s=np.nextafter(SPEED_M_S, 0.0))
    for q in QUANTITIES:
        ours, theirs = (np.asarray(getattr(h, q)) for h in (histories[0.00125], beside))
        assert np.abs(ours - theirs).max() < 1e-9 * np.abs(ours).max()
