"""Vehicles with axles on common beams: matrices by energy, and passes over a bump against DOP853.

The equations here know nothing of the package's coordinates: every body has travel, heave and pitch, every single axle
its heave, every beam heave and pitch; hinges are constraints, taken out by a null space of their rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import relative_rms
from scipy.integrate import solve_ivp
from scipy.linalg import null_space

from sysid.campaign.priors import PriorOverride
from sysid.campaign.statics import static_equilibrium
from sysid.campaign.toml.groups import check_groups
from sysid.campaign.vehicle_records import Axle, AxleGroup, Body, LoadCase, Vehicle
from sysid.errors import CampaignError
from sysid.vehicle_model.assembly import assemble, coordinate_names
from sysid.vehicle_model.contact import effective_road, road_input, tire_law
from sysid.vehicle_model.simulation import (
    Motion,
    SensorLayout,
    simulate_histories,
    simulate_sensors,
    stage_times,
)
from sysid.vehicle_model.stacked_matrices import SPEED_HOLD_S, stack_matrices
from sysid.vehicle_model.suspension import Ramps, SuspensionLaw
from sysid.vehicle_model.vibration_modes import natural_modes

AXLES = (
    Axle("steer", 0, 0.0, 540.0, 1.7e6, 2500.0, 0.48, "leaf"),
    Axle("drive 1", 0, 3.9, 900.0, 2.9e6, 3000.0, 0.5, "leaf"),
    Axle("drive 2", 0, 5.3, 700.0, 2.7e6, 2800.0, 0.5, "leaf"),
    Axle("trailer 1", 1, 11.0, 0.0, 2.6e6, 3000.0, 0.46, "leaf"),
    Axle("trailer 2", 1, 12.3, 600.0, 2.8e6, 3100.0, 0.46, "leaf"),
    Axle("trailer 3", 1, 13.5, 650.0, 2.8e6, 3200.0, 0.46, "leaf"),
)
GROUPS = (AxleGroup("tandem", (1, 2), 350.0, 120.0), AxleGroup("tri-axle", (3, 4, 5), 900.0, 400.0))
VEHICLE = Vehicle("grouped", (Body("tractor"), Body("trailer", 4.4, 1.2)), AXLES, groups=GROUPS)
LOAD = LoadCase("half", (5200, 6100, 5900, 5600, 5800, 5500), (7200, 22260), (16e3, 150e3), (1.0, 1.6))
SUSPENSION_OF = np.array([0, 1, 1, 3, 3, 3])
STIFFNESS = np.array([4.1e5, 1.6e6, np.nan, 2.9e6, np.nan, np.nan])
DAMPING = np.array([1.0e4, 3.1e4, np.nan, 4.4e4, np.nan, np.nan])
EXPONENT = 1.2
SPEED_M_S, START_S, DURATION_S, OUTPUT_S, FINE_S = 9.0, 0.3, 2.6, 0.005, 0.00125
POINTS = ((0, 0.4), (1, 12.0))
X = np.array([a.x_m for a in AXLES])
BODY = np.array([a.body for a in AXLES])


def road(s: np.ndarray, order: int = 0) -> np.ndarray:
    """A bump of 45 mm and its slope; the wheels follow it as points."""
    t = (s - 0.6) / 0.25
    return 0.045 * np.exp(-(t**2)) * (-2 * t / 0.25 if order else 1.0)


@dataclass(frozen=True)
class Equations:
    """Energies in the coordinates p = (xi, z, theta of both bodies; z_1; u, psi of the tandem; u, psi of the tri-axle).

    Rows (., 11) give motions from p: `above` and `wheel` of each axle, `forward` of each wheel centre, `extension` of
    the three suspensions.  `free` (11, 9) spans what the hinge allows.
    """

    def __post_init__(self) -> None:
        cg_x = static_equilibrium(VEHICLE, LOAD).cg_x_m
        cg_h = np.array(LOAD.cg_height_m)
        unit = np.eye(11)
        xi, z, theta = unit[[0, 3]], unit[[1, 4]], unit[[2, 5]]

        def up(body: int, x: float) -> np.ndarray:
            return z[body] - theta[body] * (x - cg_x[body])

        def ahead(body: int, h: float) -> np.ndarray:
            return xi[body] - theta[body] * (h - cg_h[body])

        wheel, extension = [unit[6]], [up(0, 0.0) - unit[6]]
        energy = np.diag([LOAD.sprung_mass_kg[0]] * 2 + [LOAD.pitch_inertia_kg_m2[0]] + [LOAD.sprung_mass_kg[1]] * 2
                         + [LOAD.pitch_inertia_kg_m2[1]] + [0.0] * 5)  # fmt: skip
        share = np.array([a.unsprung_mass_kg for a in AXLES])
        for (first, second), group in zip(((7, 8), (9, 10)), GROUPS, strict=True):
            members = list(group.axles)
            middle = X[members].mean()
            wheel += [unit[first] - unit[second] * (X[i] - middle) for i in members]
            extension.append(up(BODY[members[0]], middle) - unit[first])
            energy += group.mass_kg * np.outer(unit[first], unit[first])
            energy += group.pitch_inertia_kg_m2 * np.outer(unit[second], unit[second])
            share[members] += group.mass_kg / len(members)  # fore and aft the beam moves with its wheels
        forward = [ahead(a.body, a.tire_radius_m) for a in AXLES]
        for i, a in enumerate(AXLES):
            energy += a.unsprung_mass_kg * np.outer(wheel[i], wheel[i]) + share[i] * np.outer(forward[i], forward[i])
        support = (np.array(LOAD.axle_loads_kg) - share) * 9.81
        # The hinge load is what the trailer's own suspensions do not carry of its weight.
        hitch = LOAD.sprung_mass_kg[1] * 9.81 - support[3:].sum()
        below = np.array([a.tire_radius_m for a in AXLES]) - cg_h[BODY]
        tilt = [(support * below)[BODY == 0].sum() - hitch * (1.2 - cg_h[0]),
                (support * below)[BODY == 1].sum() + hitch * (1.2 - cg_h[1])]  # fmt: skip
        hinge = np.array([up(0, 4.4) - up(1, 4.4), ahead(0, 1.2) - ahead(1, 1.2)])
        self.__dict__.update(
            wheel=np.array(wheel),
            above=np.array([up(a.body, a.x_m) for a in AXLES]),
            extension=np.array(extension),
            forward=np.array(forward),
            points=np.array([up(*p) for p in POINTS]),
            free=null_space(hinge),
            mass=energy,
            stiffness=sum(t * np.outer(theta[b], theta[b]) for b, t in enumerate(tilt)),
            hold=float((sum(LOAD.axle_loads_kg)) / SPEED_HOLD_S) * np.outer(xi[0], xi[0]),
            static=np.array(LOAD.axle_loads_kg) * 9.81,
        )
        self.__dict__["rest"] = EXPONENT * self.static / np.array([a.tire_stiffness_N_per_m for a in AXLES])
        self.__dict__["reduced"] = self.free.T @ self.mass @ self.free

    def pull(self, extension: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return STIFFNESS[[0, 1, 3]] * extension + DAMPING[[0, 1, 3]] * rate

    def signals(self, t: float, y: np.ndarray) -> dict[str, np.ndarray]:
        p, v = self.free @ y[:9], self.free @ y[9:]
        rise, rise_rate = self.wheel @ p, self.wheel @ v
        s = SPEED_M_S * (t - START_S) - X + self.forward @ p
        speed = SPEED_M_S + self.forward @ v
        x = (self.rest + road(s) - rise) / self.rest
        grip = np.maximum(x, 0.0) * np.sqrt(1.1 / (np.maximum(x, 0.0) + 0.1))
        ct = np.array([a.tire_damping_N_s_per_m for a in AXLES])
        elastic = self.static * np.sign(x) * np.abs(x) ** EXPONENT
        vertical = np.maximum(elastic + ct * grip * (road(s, 1) * speed - rise_rate), 0.0)
        pull = self.pull(self.extension @ p, self.extension @ v)
        force = self.wheel.T @ (vertical - self.static) - self.extension.T @ pull - self.stiffness @ p - self.hold @ v
        a = self.free @ np.linalg.solve(self.reduced, self.free.T @ force)
        shown = np.zeros(6)
        shown[[0, 1, 3]] = -pull
        return {
            "acceleration": a,
            "axle_acceleration": self.wheel @ a,
            "body_acceleration": self.points @ a,
            "deflection": (self.above - self.wheel) @ p,
            "tire_force": vertical,
            "suspension_force": shown[[0, 1, 3]],
        }

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[9:], self.free.T @ self.signals(t, y)["acceleration"]])

    def histories(self) -> dict[str, np.ndarray]:
        times = np.arange(round(DURATION_S / OUTPUT_S)) * OUTPUT_S
        found = solve_ivp(
            self.rates, (0.0, times[-1]), np.zeros(18), "DOP853", times, rtol=1e-10, atol=1e-12, max_step=0.01
        )
        rows = [self.signals(t, y) for t, y in zip(times, found.y.T, strict=True)]
        return {q: np.array([r[q] for r in rows]) for q in rows[0]}


class WithStops(Equations):
    """The same with a stop 12 mm above the middle of the tri-axle beam."""

    def pull(self, extension: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return super().pull(extension, rate) + np.array([0.0, 0.0, -4e6 * max(0.0, -0.012 - extension[2])])


QUANTITIES = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "suspension_force")


def simulated(step_s: float, *, stops: bool = False, sensors: bool = False):
    stacked = stack_matrices([assemble(VEHICLE, LOAD)], list(POINTS))
    station = np.arange(-150, 300) * 0.01
    table = effective_road(station, np.tile(road(station), (1, 6, 1)))
    samples, substeps = round(DURATION_S / OUTPUT_S), round(OUTPUT_S / step_s)

    def per_axle(values) -> jax.Array:
        return jnp.asarray(np.asarray(values, float)[None, :, None])

    @jax.jit
    def run():
        # What stands at the other axles of a group must not matter.
        k, c = (np.where(np.isnan(v), 7e6, v) for v in (STIFFNESS, DAMPING))
        ramps = None
        if stops:
            at, slope = (per_axle(v)[None] for v in ([-0.012] * 6, [0, 0, 5e8, 4e6, 9e8, 9e8]))
            ramps = Ramps(at, slope, jnp.full((1, 1, 1, 1), -1.0))
        suspension = SuspensionLaw(per_axle(k), per_axle(c), ramps=ramps)
        tire = tire_law(
            per_axle([a.tire_stiffness_N_per_m for a in AXLES]),
            per_axle([a.tire_damping_N_s_per_m for a in AXLES]),
            EXPONENT,
            stacked.static_load,
            stacked.static_load,
        )
        motion = Motion(jnp.full((1, 1), SPEED_M_S), jnp.full((1, 1), START_S))
        times = stage_times(samples, OUTPUT_S, substeps)[:, None, None, None]
        inputs = road_input(table, SPEED_M_S * (times - START_S) - X[:, None])
        options = {"interval_s": OUTPUT_S, "substeps": substeps}
        if sensors:
            layout = SensorLayout((5, 0), (2,))
            return simulate_sensors(stacked, suspension, tire, motion, inputs, layout, None, **options)
        return simulate_histories(stacked, suspension, tire, motion, inputs, **options)

    return run()


@pytest.fixture(scope="module")
def exact() -> dict[str, np.ndarray]:
    return Equations().histories()


def test_wheels_of_both_groups_leave_the_road(exact):
    assert (exact["tire_force"].min(axis=0) == 0.0).sum() >= 3


@pytest.mark.parametrize(("step_s", "limit"), [(0.0025, 5e-3), (0.00125, 5e-4)])
def test_histories_over_a_bump(exact, step_s, limit):
    ours = simulated(step_s)
    for quantity in QUANTITIES:
        values = np.asarray(getattr(ours, quantity))[:, 0, :, 0]
        if quantity == "suspension_force":
            np.testing.assert_array_equal(values[:, [2, 4, 5]], 0.0)
            values = values[:, [0, 1, 3]]
        error = relative_rms(values, exact[quantity])
        assert error.max() < limit, (quantity, error)


def test_sensors_sit_at_the_axles(exact):
    ours = np.asarray(simulated(0.00125, sensors=True))[:, 0, :, 0]
    parts = (exact["deflection"][:, [5, 0]], exact["axle_acceleration"][:, [2]], exact["body_acceleration"])
    assert relative_rms(ours, np.concatenate(parts, axis=1)).max() < 5e-4


def test_stops_act_at_the_middle_of_a_beam(exact):
    ours, theirs = simulated(0.00125, stops=True), WithStops().histories()
    for quantity in QUANTITIES[:4]:
        error = relative_rms(np.asarray(getattr(ours, quantity))[:, 0, :, 0], theirs[quantity])
        assert error.max() < 2e-3, (quantity, error)
    assert relative_rms(exact["tire_force"], theirs["tire_force"]).max() > 0.05


def test_modes_are_those_of_the_energies():
    e = Equations()
    wheel, extension = e.wheel @ e.free, e.extension @ e.free
    kt = np.array([a.tire_stiffness_N_per_m for a in AXLES])
    k = extension.T @ (STIFFNESS[[0, 1, 3]][:, None] * extension) + wheel.T @ (kt[:, None] * wheel)
    k += e.free.T @ e.stiffness @ e.free
    square = np.sort(np.linalg.eigvals(np.linalg.solve(e.reduced, k)).real)
    assert abs(square[0]) < 1e-6 * square[1]  # the rigid fore-aft motion
    modes = natural_modes(VEHICLE, LOAD, STIFFNESS)
    np.testing.assert_allclose(modes.frequency_hz, np.sqrt(square[1:]) / (2 * np.pi), rtol=1e-9)
    assert coordinate_names(VEHICLE)[4:] == (
        "heave steer", "heave tandem", "pitch tandem", "heave tri-axle", "pitch tri-axle",
    )  # fmt: skip


def test_body_stands_on_the_middle_of_a_group():
    """Moments about the hinge: the trailer's supports act together at the middle of the tri-axle."""
    statics = static_equilibrium(VEHICLE, LOAD)
    support = (5600 + 5800 + 5500 - 900 - 600 - 650) * 9.81
    middle = (11.0 + 12.3 + 13.5) / 3
    assert statics.hitch_load_N[1] == pytest.approx(22260 * 9.81 - support)
    assert 22260 * 9.81 * (statics.cg_x_m[1] - 4.4) == pytest.approx(support * (middle - 4.4))


def test_a_group_of_one_axle_is_that_axle_with_more_mass():
    axles = (replace(AXLES[0], unsprung_mass_kg=100.0), *AXLES[1:])
    split = replace(VEHICLE, axles=axles, groups=(AxleGroup("front", (0,), 440.0, 0.0), *GROUPS))
    whole = natural_modes(VEHICLE, LOAD, STIFFNESS)
    np.testing.assert_allclose(natural_modes(split, LOAD, STIFFNESS).frequency_hz, whole.frequency_hz, rtol=1e-12)


@pytest.mark.parametrize(
    ("groups", "axle", "words"),
    [
        ((AxleGroup("a", (0, 1), 1.0, 1.0), AxleGroup("b", (1, 2), 1.0, 1.0)), {}, "'drive 1' stands in two groups"),
        ((AxleGroup("a", (2, 3), 1.0, 1.0),), {}, "under two bodies"),
        ((AxleGroup("a", (0, 2), 1.0, 1.0),), {}, "leaves out the axle 'drive 1'"),
        ((AxleGroup("a", (1, 2), 1.0, 1.0),), {"suspension": "air"}, "'drive 2' has another suspension"),
        ((AxleGroup("a", (1, 2), 1.0, 1.0),), {"jounce_travel_m": 0.1}, "another jounce_travel_m"),
        ((AxleGroup("a", (1, 2), 1.0, 1.0),), {"priors": {"stiffness": PriorOverride(1e6, 0.2)}}, "priors"),
        ((AxleGroup("a", (1, 2), 0.0, 1.0),), {"unsprung_mass_kg": 0.0}, "'drive 2' has unsprung_mass_kg = 0"),
        ((), {"unsprung_mass_kg": 0.0}, "'drive 2' has unsprung_mass_kg = 0"),
    ],
)
def test_groups_that_are_no_beam_are_refused(groups, axle, words):
    axles = (*AXLES[:2], replace(AXLES[2], **axle), *(replace(a, unsprung_mass_kg=500.0) for a in AXLES[3:]))
    with pytest.raises(CampaignError, match=words) as error:
        check_groups(replace(VEHICLE, axles=axles, groups=groups), "campaign.toml")
    assert "\n" not in str(error.value)


def test_a_beam_without_inertia_is_refused():
    axles = tuple(replace(a, unsprung_mass_kg=0.0) for a in AXLES)
    groups = (*(AxleGroup(f"{i}", (i,), 500.0, 0.0) for i in range(4)), AxleGroup("pair", (4, 5), 900.0, 0.0))
    with pytest.raises(CampaignError, match="'pair' has no pitch inertia"):
        check_groups(replace(VEHICLE, axles=axles, groups=groups), "campaign.toml")
