"""The native engine against the reference engine: signals and histories."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rigid_truck
import verification_case
from native_engine import needs_native

from sysid.campaign.records import AntiAliasFilter
from sysid.campaign.vehicle_records import AxleGroup, Equaliser, FrameBending, LoadCase, Vehicle
from sysid.vehicle_model import engine
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import TireLaw, effective_road, tire_law
from sysid.vehicle_model.engine import Timing
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.simulation import SensorLayout
from sysid.vehicle_model.stacked_matrices import StackedMatrices, stack_matrices
from sysid.vehicle_model.suspension import ELEMENT_FIELDS, FrameLaw, Ramps, SuspensionLaw

#: One run brakes, the other gathers speed.
SPEED_M_S, START_S, ACCELERATION = np.array([[7.0], [9.5]]), np.array([[0.31], [0.27]]), np.array([[-0.1], [0.6]])
#: The first bump throws every wheel into the air, the second none.
HEIGHT_M = np.array([0.08, 0.01])[:, None, None]
SETS = 11
STIFFNESS, DAMPING = 4e5, 1.2e4


class Case:
    """Two runs of a vehicle, one per load case, over two bumps with footprint maps, for several parameter sets."""

    def __init__(
        self, vehicle: Vehicle, loads: list[LoadCase], *, footprint: bool, samples: int = 220, sets: int = SETS
    ):
        self.axle_x = np.array([a.x_m for a in vehicle.axles])[:, None]
        matrices = [assemble(vehicle, case) for case in loads]
        self.stacked: StackedMatrices = stack_matrices(matrices, [(0, 0.4), (len(vehicle.bodies) - 1, 9.0)])
        axles = len(vehicle.axles)
        station = np.round(np.arange(-1.0, 1.6, 0.01), 6)
        shape = np.exp(-(((station - 0.3) / 0.17) ** 2))
        slope = -2 * (station - 0.3) / 0.17**2 * shape
        every = np.ones((2, axles, 1))
        stretch = np.stack([every * a * shape for a in (0.2, 0.9, -7.0, 0.004)]) if footprint else None
        drag = np.stack([every * a * slope for a in (-0.03, 0.2, 1.0)]) if footprint else None
        self.road = effective_road(station, HEIGHT_M * every * shape, stretch, drag)
        self.motion = Motion(SPEED_M_S, START_S, ACCELERATION)
        self.timing = Timing(samples, 0.005, 3)
        self.layout = SensorLayout(tuple(range(axles)), (0, axles - 1))
        self.random = np.random.default_rng(20240607)
        factor = np.exp(0.15 * self.random.normal(size=(6, 2, axles, sets)))
        tire = np.array([a.tire_stiffness_N_per_m for a in vehicle.axles])[:, None] * factor[2]
        self.suspension = SuspensionLaw(jnp.asarray(STIFFNESS * factor[0]), jnp.asarray(DAMPING * factor[1]))
        self.tire: TireLaw = tire_law(
            jnp.asarray(tire),
            3e3 * factor[3],
            1.2 * factor[4, 0, 0],
            self.stacked.static_load,
            self.stacked.static_load,
        )

    def only(self, sets: slice) -> tuple[SuspensionLaw, TireLaw]:
        """Laws of some of the parameter sets."""
        suspension, tire = jax.tree.map(
            lambda x: x[..., sets] if getattr(x, "ndim", 0) and x.shape[-1] == SETS else x,
            (self.suspension, self.tire._replace(growth=None)),
        )
        return suspension, tire._replace(growth=self.tire.growth)

    def sensors(self, antialias: AntiAliasFilter | None, sets: slice = slice(None)) -> np.ndarray:
        """Signals (T, R, C, S) by the engine of the process."""
        step = self.timing.interval_s / self.timing.substeps
        recursion = None if antialias is None else discretise(antialias, step)
        wheels = self._wheels()

        @jax.jit
        def run(suspension, tire, wheels):
            tire = tire._replace(growth=self.tire.growth)
            return wheels.engine.sensors(self.stacked, suspension, tire, wheels, self.timing, self.layout, recursion)

        suspension, tire = self.only(sets)
        return np.asarray(run(suspension, tire._replace(growth=None), wheels))

    def histories(self):
        """Unfiltered histories by the engine of the process."""
        wheels = self._wheels()

        @jax.jit
        def run(wheels):
            return wheels.engine.histories(self.stacked, self.suspension, self.tire, wheels, self.timing)

        return run(wheels)

    def _wheels(self):
        motion = Motion(*(jnp.asarray(x) for x in self.motion[:3]))
        return engine.wheel_road(self.stacked, self.road, self.axle_x, motion, self.timing)


def truck(**options) -> Case:
    """Three axles on one body; empty and laden."""
    return Case(rigid_truck.VEHICLE, [rigid_truck.EMPTY, rigid_truck.LADEN], **options)


def tractor_and_trailer(**options) -> Case:
    """Six axles on two bodies with a hinge above the wheels; unloaded and loaded."""
    vehicle, loads = verification_case.vehicle_and_loads(heights=True)
    return Case(vehicle, list(loads.values()), **options)


def assert_same(ours: np.ndarray, theirs: np.ndarray, tolerance: float = 1e-12) -> None:
    """Equal to a share of the largest value that any time and set of a channel shows."""
    peak = np.abs(theirs).max(axis=(0, 3), keepdims=True)
    assert (peak > 0.0).all()
    assert (np.abs(ours - theirs) / peak).max() < tolerance


@pytest.fixture
def both(monkeypatch):
    """Calls a function with the native engine and with the reference engine."""

    def call(function):
        found = []
        for name in ("native", "reference"):
            monkeypatch.setenv("SYSID_ENGINE", name)
            found.append(function())
        return found

    return call


@needs_native
@pytest.mark.parametrize("antialias", [rigid_truck.FILTER, AntiAliasFilter("bessel", 3, 80.0), None])
def test_sensors_of_the_truck(both, antialias):
    ours, theirs = both(lambda: truck(footprint=True).sensors(antialias))
    assert ours.shape == (220, 2, 7, SETS)
    assert_same(ours, theirs)


@needs_native
def test_a_traced_call_gives_the_bits_of_a_direct_one(monkeypatch):
    """Directly with NumPy's arrays, and in a function that JAX compiles: the engine is the same."""
    monkeypatch.setenv("SYSID_ENGINE", "native")
    case = truck(footprint=True, samples=90)
    traced = case.sensors(rigid_truck.FILTER)
    recursion = discretise(rigid_truck.FILTER, case.timing.interval_s / case.timing.substeps)
    suspension, tire = jax.tree.map(np.asarray, (case.suspension, case.tire._replace(growth=None)))
    wheels = engine.wheel_road(case.stacked, case.road, case.axle_x, case.motion, case.timing)
    given = suspension, tire._replace(growth=case.tire.growth), wheels, case.timing, case.layout, recursion
    direct = wheels.engine.sensors(case.stacked, *given)
    assert isinstance(direct, np.ndarray)
    np.testing.assert_array_equal(direct, traced)


@needs_native
@pytest.mark.parametrize("footprint", [True, False], ids=["footprint", "point"])
def test_histories_of_tractor_and_trailer(both, footprint):
    ours, theirs = both(lambda: tractor_and_trailer(footprint=footprint, samples=540, sets=3).histories())
    assert np.asarray(theirs.tire_force)[:, 0].min() == 0.0
    assert np.asarray(theirs.tire_force)[:, 1].min() > 0.0
    for name, mine, other in zip(theirs._fields, ours, theirs, strict=True):
        if name == "horizontal_force" and not footprint:
            np.testing.assert_array_equal(mine, other)
        else:
            assert_same(np.asarray(mine), np.asarray(other))


def ramps(case: Case, at: tuple[float, ...], slope: float) -> Ramps:
    """Ramps on both sides of rest, other ones on every axle and for every set."""
    shape = case.suspension.stiffness.shape
    place = np.array(at)[:, None, None, None] * np.exp(0.1 * case.random.normal(size=(len(at), *shape)))
    steepness = slope * np.exp(0.1 * case.random.normal(size=place.shape))
    return Ramps(*(jnp.asarray(x) for x in (place, steepness, np.sign(place))))


def elements(case: Case) -> dict[str, dict]:
    """Elements of suspension laws with values that one pass over the bumps exercises, other ones for every set."""

    def varied(value: float) -> jax.Array:
        return jnp.asarray(value * np.exp(0.2 * case.random.normal(size=case.suspension.stiffness.shape)))

    return {
        "gas spring": {"softening": varied(4.0), "stiffening": varied(30.0)},
        "saturating damper": {"saturation": varied(0.3), "rounding": varied(0.6), "tail": varied(0.2)},
        "asymmetric damper": {"asymmetry": varied(2.5)},
        "friction": {"friction": varied(2000.0), "slip": varied(1e-3)},
        "friction of leaves": {
            "friction": varied(2000.0),
            "slip": varied(2e-3),
            "friction_growth": varied(10.0),
            "sliding": varied(0.6),
            "sliding_rate": varied(0.1),
        },
        "damper bushing": {"compliance": varied(3e-7)},
        "trailing links": {"trailing": varied(0.08)},
        "spring corners": {"ramps": ramps(case, (0.012, 0.02, -0.015), 1e6)},
        "stops": {"stops": ramps(case, (0.015, -0.018), 1.5e6)},
        "damper corners": {"rate_ramps": ramps(case, (0.1, -0.2), 1e4)},
    }


@needs_native
@pytest.mark.parametrize("element", [*elements(truck(footprint=False)), "all of them"])
def test_every_element_of_suspension_laws(both, element):
    def run() -> tuple[np.ndarray, np.ndarray]:
        case = truck(footprint=True, samples=180)
        linear, every = case.sensors(rigid_truck.FILTER), elements(case)
        chosen = (
            {k: v for fields in every.values() for k, v in fields.items()} if element not in every else every[element]
        )
        case.suspension = case.suspension._replace(**chosen)
        return case.sensors(rigid_truck.FILTER), linear

    (ours, linear), (theirs, _) = both(run)
    assert_same(ours, theirs)
    # On the high bump the element is at work.
    assert (np.abs(ours - linear)[:, 0, :3].max(axis=(0, 2)) > 1e-4).all()


def test_every_coefficient_of_an_element_is_in_that_comparison():
    """An engine could leave out an element that nobody compares; rockers have a test of their own."""
    compared = {field for fields in elements(truck(footprint=False)).values() for field in fields}
    assert {field for fields in ELEMENT_FIELDS.values() for field in fields} - compared == {"load_share"}


@needs_native
def test_damping_that_grows_otherwise_on_every_tire(both):
    def run() -> tuple[np.ndarray, np.ndarray]:
        case = truck(footprint=True, samples=180)
        plain = case.sensors(rigid_truck.FILTER)
        case.tire = case.tire._replace(growth=np.array([[[0.0], [0.4], [0.9]], [[1.0], [0.2], [0.0]]]))
        return case.sensors(rigid_truck.FILTER), plain

    (ours, plain), (theirs, _) = both(run)
    assert_same(ours, theirs)
    assert np.abs(ours - plain).max() > 1e-3


@needs_native
def test_axle_groups(both):
    """A bogie on a beam, with friction, stops and an asymmetric damper."""
    vehicle = replace(rigid_truck.VEHICLE, groups=(AxleGroup("bogie", (1, 2), 300.0, 90.0),))
    loads = [replace(c, sprung_mass_kg=(c.sprung_mass_kg[0] - 300.0,)) for c in (rigid_truck.EMPTY, rigid_truck.LADEN)]

    def run():
        case = Case(vehicle, loads, footprint=True, samples=260, sets=3)
        every = elements(case)
        chosen = every["friction"] | every["spring corners"] | every["asymmetric damper"]
        case.suspension = case.suspension._replace(**chosen)
        return case.histories(), case.sensors(rigid_truck.FILTER)

    (ours, our_sensors), (theirs, their_sensors) = both(run)
    for name, mine, other in zip(theirs._fields, ours, theirs, strict=True):
        mine, other = np.asarray(mine), np.asarray(other)
        if name == "suspension_force":  # the group's stands at its first axle
            np.testing.assert_array_equal(mine[:, :, 2], 0.0)
            mine, other = mine[:, :, :2], other[:, :, :2]
        assert_same(mine, other)
    assert_same(our_sensors, their_sensors)


@needs_native
def test_rockers_between_springs(both):
    """A tandem whose springs share, beside a steer axle on its own, with every other element."""
    vehicle = replace(rigid_truck.VEHICLE, equalisers=(Equaliser("tandem", (1, 2)),))

    def run():
        case = Case(vehicle, [rigid_truck.EMPTY, rigid_truck.LADEN], footprint=True, samples=300, sets=5)
        chosen = {k: v for fields in elements(case).values() for k, v in fields.items()}
        case.suspension = case.suspension._replace(**chosen)
        alone = case.sensors(rigid_truck.FILTER, slice(None))
        share = case.random.uniform(0.3, 1.0, case.suspension.stiffness.shape) * np.array([0.0, 1.0, 1.0])[:, None]
        case.suspension = case.suspension._replace(load_share=jnp.asarray(share))
        return case.histories(), case.sensors(rigid_truck.FILTER), alone

    (ours, our_sensors, alone), (theirs, their_sensors, _) = both(run)
    for mine, other in zip(ours, theirs, strict=True):
        assert_same(np.asarray(mine), np.asarray(other))
    assert_same(our_sensors, their_sensors)
    assert (np.abs(our_sensors - alone)[:, 0, 1:3].max(axis=(0, 2)) > 1e-4).all()


@needs_native
def test_frames_that_bend(both):
    """Tractor and trailer that both bend: six body coordinates."""
    vehicle, loads = verification_case.vehicle_and_loads(heights=True)
    bent = tuple(replace(b, bending=FrameBending(hz, 0.03)) for b, hz in zip(vehicle.bodies, (11.0, 8.0), strict=True))

    def run():
        case = Case(replace(vehicle, bodies=bent), list(loads.values()), footprint=True, samples=540, sets=2)
        assert case.stacked.body_rows.shape[2] == 6
        shape = (2, 2, case.suspension.stiffness.shape[-1])
        turn = 2 * np.pi * np.array([11.0, 8.0])[:, None] * np.exp(0.1 * case.random.normal(size=shape))
        ratio = 0.03 * np.exp(0.3 * case.random.normal(size=shape))
        frames = FrameLaw(jnp.asarray(turn**2), jnp.asarray(2 * ratio * turn))
        case.suspension = case.suspension._replace(frames=frames)
        return case.histories(), case.sensors(rigid_truck.FILTER)

    (ours, our_sensors), (theirs, their_sensors) = both(run)
    for mine, other in zip(ours, theirs, strict=True):
        assert_same(np.asarray(mine), np.asarray(other), 1e-11)
    assert_same(our_sensors, their_sensors, 1e-11)


@needs_native
def test_a_set_does_not_depend_on_its_batch(monkeypatch):
    """To the last bit in another place of another pack, and again; alone, where runs share packs, to rounding."""
    monkeypatch.setenv("SYSID_ENGINE", "native")
    case = truck(footprint=True)
    every = elements(case)
    case.suspension = case.suspension._replace(**every["friction"], **every["spring corners"], **every["gas spring"])
    together = case.sensors(rigid_truck.FILTER)
    np.testing.assert_array_equal(case.sensors(rigid_truck.FILTER), together)
    np.testing.assert_array_equal(case.sensors(rigid_truck.FILTER, slice(2, 11)), together[..., 2:11])
    assert_same(case.sensors(rigid_truck.FILTER, slice(9, 10)), together[..., 9:10])


def as_runs(case: Case, sets: range) -> Case:
    """Every set of a case as runs of their own, with one set each."""
    apart = copy(case)
    parts = [case.only(slice(k, k + 1)) for k in sets]
    apart.suspension, tire = jax.tree.map(
        lambda *x: jnp.concatenate(x, axis=-3) if x[0].ndim > 2 else x[0],
        *((s, t._replace(growth=None)) for s, t in parts),
    )
    loads = jnp.concatenate([jnp.broadcast_to(case.tire.reference_load, case.stacked.static_load.shape)] * len(sets))
    exponent = jnp.concatenate(
        [jnp.broadcast_to(t.exponent, (*loads.shape[:0], 2, loads.shape[1], 1)) for _, t in parts]
    )
    apart.tire = tire._replace(growth=case.tire.growth, reference_load=loads, exponent=exponent)
    apart.stacked = jax.tree.map(lambda x: np.concatenate([x] * len(sets)), case.stacked)
    apart.road = replace(
        case.road,
        **{
            name: np.concatenate([getattr(case.road, name)] * len(sets), axis=-3)
            for name in ("rise", "stretch", "drag")
        },
    )
    apart.motion = Motion(*(np.tile(x, (len(sets), 1)) for x in (SPEED_M_S, START_S, ACCELERATION)))
    return apart


@needs_native
@pytest.mark.parametrize("made", [truck, tractor_and_trailer])
def test_runs_with_one_set_each_share_packs(monkeypatch, made):
    """Sets of two runs as 22 runs: the same signals and histories, and to the last bit those of fewer runs."""
    monkeypatch.setenv("SYSID_ENGINE", "native")
    case = made(footprint=True)
    every = elements(case)
    case.suspension = case.suspension._replace(**every["friction"], **every["spring corners"], **every["gas spring"])
    together, apart = case.sensors(rigid_truck.FILTER), as_runs(case, range(SETS)).sensors(rigid_truck.FILTER)
    assert_same(np.moveaxis(apart[..., 0].reshape(len(apart), SETS, 2, -1), 1, -1), together)
    for packed, by_sets in zip(as_runs(case, range(SETS)).histories(), case.histories(), strict=True):
        ours = np.moveaxis(np.asarray(packed)[..., 0].reshape(len(packed), SETS, 2, -1), 1, -1)
        # In this time the last axles do not reach the bump: their horizontal forces are zero.
        np.testing.assert_allclose(ours, by_sets, rtol=0.0, atol=1e-12 * np.abs(by_sets).max())
    few = as_runs(case, range(3, 5)).sensors(rigid_truck.FILTER)
    np.testing.assert_array_equal(few, apart[:, 6:10])


@needs_native
@pytest.mark.parametrize("rows", [(0.2, 0.9, -7.0, 0.004, -0.03, 0.2, 1.0), (0.0, 0.0, 0.0, 0.0, -0.03, 0.0, 0.0)])
def test_runs_over_one_road_share_its_footprint_map(both, rows):
    """Eleven vehicles at one speed over bumps of other heights, with one map of all rows or of a drag alone."""
    case = as_runs(truck(footprint=True), range(SETS))
    case.motion = Motion(*(np.full_like(x, x[0, 0]) for x in case.motion[:3]))
    case.road = replace(
        case.road,
        rise=case.road.rise * np.linspace(0.2, 1.0, 2 * SETS)[:, None, None],
        stretch=np.stack([row / 0.2 * case.road.stretch[0, :1] for row in rows[:4]]),
        drag=np.stack([row / -0.03 * case.road.drag[0, :1] for row in rows[4:]]),
    )
    ours, theirs = both(case.histories)
    for mine, other in zip(ours, theirs, strict=True):
        assert (np.abs(mine - other)).max() < 1e-11 * np.abs(other).max()
    apart = copy(case)
    every = {name: np.repeat(getattr(case.road, name), 2 * SETS, axis=1) for name in ("stretch", "drag")}
    apart.road = replace(case.road, **every)
    mine, _ = both(apart.histories)
    assert np.abs(mine.tire_force - ours.tire_force).max() < 1e-11 * np.abs(ours.tire_force).max()
    apart.road = replace(apart.road, drag=1.001 * apart.road.drag)
    mine, _ = both(apart.histories)
    assert np.abs(mine.tire_force - ours.tire_force).max() > 1e-11 * np.abs(ours.tire_force).max()


@needs_native
@pytest.mark.parametrize("apart", [False, True], ids=["sets", "runs"])
def test_a_road_with_edges_is_looked_up_where_wheels_are(both, apart):
    """Over waves of 0.1 m a Taylor series about the place at even speed is a little off where a wheel is behind it."""
    case = truck(footprint=True)
    if apart:
        case = as_runs(case, range(SETS))
    station = case.road.first_station_m + case.road.step_m * np.arange(case.road.rise.shape[-1])
    case.road = replace(case.road, rise=case.road.rise * (1.0 + 0.2 * np.cos(20.0 * np.pi * station)))
    smooth, _ = both(case.histories)
    case.road = replace(case.road, edged=True)
    ours, theirs = both(case.histories)
    for mine, other, by_series in zip(ours, theirs, smooth, strict=True):
        assert_same(np.asarray(mine), np.asarray(other), 1e-11)
        assert np.abs(np.asarray(mine) - np.asarray(by_series)).max() > 1e-6 * np.abs(np.asarray(mine)).max()


@needs_native
def test_a_set_that_is_not_finite_spoils_no_other(monkeypatch):
    monkeypatch.setenv("SYSID_ENGINE", "native")
    case = truck(footprint=True)
    good = case.sensors(rigid_truck.FILTER)
    case.suspension = case.suspension._replace(stiffness=case.suspension.stiffness.at[..., 4].set(np.nan))
    case.tire = case.tire._replace(damping=jnp.asarray(case.tire.damping).at[..., 6].set(np.inf))
    found = case.sensors(rigid_truck.FILTER)
    finite = np.isfinite(found).all(axis=(0, 1, 2))
    np.testing.assert_array_equal(finite, ~np.isin(np.arange(SETS), (4, 6)))
    np.testing.assert_array_equal(found[..., finite], good[..., finite])


@needs_native
def test_small_numbers_of_the_caller_stay(monkeypatch):
    """Inside the engine numbers too small to be normal count as zero; in the thread that calls it they do not."""
    monkeypatch.setenv("SYSID_ENGINE", "native")
    case = truck(footprint=False, samples=20, sets=1)
    wheels = engine.wheel_road(case.stacked, case.road, case.axle_x, case.motion, case.timing)
    laws = jax.tree.map(np.asarray, case.suspension), case.tire._replace(growth=1.0)
    wheels.engine.histories(case.stacked, *laws, wheels, case.timing)
    # By its bits: where such numbers count as zero they are equal to it.
    smallest = np.array([1]).view(float)
    assert np.multiply(smallest, 4.0).view(int)[0] == 4
