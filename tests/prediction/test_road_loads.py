"""Axle loads over rough roads: the golden car against its covariance, a bump as a road, and measures by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import EMPTY, VEHICLE, bump, campaign, empty_run, true_log_parameters
from scipy.linalg import solve_continuous_lyapunov

from sysid import limits
from sysid.campaign.records import PredictionRequest
from sysid.campaign.roads import RoadCourse
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.errors import CampaignError
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.prediction import road_loads
from sysid.prediction.driven_range import driven_range
from sysid.prediction.felt_road import felt_road
from sysid.prediction.predict_passes import effective_roads, predict_pass
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.road_loads import predict_road
from sysid.road.roughness import GOLDEN_CAR, STATION_STEP_M, class_road
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import tire_law
from sysid.vehicle_model.engine import Timing, wheel_road
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import declared_tires
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import SuspensionLaw

SPEED_M_S = 10.0
STATIC_N = np.array(EMPTY.axle_loads_kg) * VEHICLE.gravity_m_s2


def golden_coefficient(name: str) -> float:
    """Dynamic load coefficient of the golden car at 80 km/h on a class, from the Lyapunov equation of its covariance.

    The slope of the road is white, so that the road moves the wheel at a velocity of spectrum
    (2 pi)^2 G_d(n_0) n_0^2 v [m2/s] (one-sided, per Hz).
    """
    tire, spring, damper, unsprung = GOLDEN_CAR
    # Sprung rate, wheel rate, extension of the suspension, deflection of the tire.
    a = np.array(
        [
            [-damper, damper, -spring, 0.0],
            [damper / unsprung, -damper / unsprung, spring / unsprung, tire / unsprung],
            [1.0, -1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0, 0.0],
        ]
    )
    b = np.array([[0.0], [0.0], [0.0], [1.0]])
    density = 0.5 * (2 * np.pi) ** 2 * 16e-6 * 4.0 ** "ABCD".index(name) * 0.01 * 80 / 3.6
    covariance = solve_continuous_lyapunov(a, -density * b @ b.T)
    return tire * np.sqrt(covariance[3, 3]) / ((1.0 + unsprung) * 9.81)


@pytest.mark.parametrize(("name", "published"), [("A", 0.0632), ("B", 0.1264), ("C", 0.2528), ("D", 0.5055)])
def test_load_coefficient_of_the_golden_car(name: str, published: float):
    """Eight kilometres of each class; the tire, a spring in both directions, is preloaded a hundredfold."""
    tire, spring, damper, unsprung = GOLDEN_CAR
    sprung = 1000.0
    axle = Axle("axle", 0, 0.0, unsprung * sprung, tire * sprung, 0.0, 0.3, "other")
    vehicle = Vehicle("golden car", (Body("body"),), (axle,), gravity_m_s2=9.81)
    load = LoadCase("golden car", ((1.0 + unsprung) * sprung,), (sprung,), (1e3,), (0.3,))
    matrices = assemble(vehicle, load)
    stacked = stack_matrices([replace(matrices, static_load=100.0 * matrices.static_load)], [])

    def one(value: float) -> np.ndarray:
        return np.full((1, 1, 1), value)

    law = tire_law(one(tire * sprung), one(0.0), np.ones(1), stacked.static_load, stacked.static_load)
    law = law._replace(growth=0.0)
    speed, samples, forces = 80 / 3.6, 23_000, []
    for seed in range(4):
        station, tracks = class_road(name, 2000.0, seed)
        road = felt_road(station, tracks[0], vehicle, load, load, declared_tires(vehicle), "point")
        # A hundredfold preload would brake the car a hundredfold.
        felt = replace(road.stretch_of(-10.0, 8.0, 2050.0), stretch=None, drag=None)
        timing = Timing(samples, 0.004, 2)
        wheels = wheel_road(
            stacked, felt, np.zeros((1, 1)), Motion(np.full((1, 1), speed), np.full((1, 1), 0.4)), timing
        )
        found = wheels.engine.histories(
            stacked, SuspensionLaw(one(spring * sprung), one(damper * sprung)), law, wheels, timing
        )
        forces.append(np.asarray(found.tire_force)[2000:22000, 0, 0, 0])
    static = (1.0 + unsprung) * sprung * 9.81
    coefficient = np.std(np.array(forces) - 100.0 * static) / static
    assert golden_coefficient(name) == pytest.approx(published, rel=2e-3)
    assert coefficient == pytest.approx(published, rel=0.02)


@pytest.fixture(scope="module")
def state():
    data = campaign([empty_run("a.csv", 9.0)], predictions=[PredictionRequest("empty", SPEED_M_S)])
    parameters = campaign_parameters(data, None)
    model = bump_model(data, parameters, {"bump": bump()})
    scale = np.ones((1, len(model.layout.sensors)))
    motion = RunMotion.steady(np.array([SPEED_M_S]), np.array([0.5]))
    return state_at(data, model, true_log_parameters(parameters.names), motion, Weights((scale,), (scale,)))


@pytest.fixture(scope="module")
def driven(state):
    return driven_range(state)


def over(state, driven, course: RoadCourse, sets: np.ndarray | None = None, speed: float = SPEED_M_S) -> PassPrediction:
    request = PredictionRequest("empty", speed, course.label, road=course)
    return predict_road(state, request, state.point.log_parameters[None] if sets is None else sets, None, driven, None)


@pytest.fixture(scope="module")
def rough(state, driven) -> PassPrediction:
    return over(state, driven, RoadCourse(300.0, "C", 3))


def test_a_bump_on_a_road_is_the_bump(state, driven):
    """The same profile by the path of bumps, with footprint maps at every millisecond; it is harsh as a road."""
    profile = bump()
    before = 12.0
    station = np.arange(0.0, 28.0, 0.005)
    height = np.interp(station - before, profile.station_m, profile.height_m, left=0.0, right=0.0)
    as_road = over(state, driven, RoadCourse(28.0, step_m=0.005, height_m=height, source="bump on a road"))
    request = PredictionRequest("empty", SPEED_M_S)
    roads = effective_roads(state, [request])
    as_bump = predict_pass(state.campaign, state.parameters, roads, request, state.point.log_parameters[None])
    at = as_road.time_s - (before + profile.start_m) / SPEED_M_S
    both = at < as_bump.time_s[-1]
    for found, known, static in zip(as_road.tire_force_q50_N[:, both], as_bump.tire_force_q50_N, STATIC_N, strict=True):
        exact = np.interp(at[both], as_bump.time_s, known)
        assert np.sqrt(np.mean((found - exact) ** 2)) < 0.02 * np.sqrt(np.mean((exact - static) ** 2))
    np.testing.assert_allclose(as_road.peak_ratio_q50, as_bump.peak_ratio_q50, rtol=0.01)


def test_stretches_make_one_road(state, driven, rough, monkeypatch):
    """Three stretches with run-ups of their own against one."""
    monkeypatch.setattr(road_loads, "STRETCH_S", 11.0)
    parts = over(state, driven, RoadCourse(300.0, "C", 3))
    dynamic = rough.tire_force_q50_N - STATIC_N[:, None]
    difference = parts.tire_force_q50_N - rough.tire_force_q50_N
    assert np.all(difference.std(axis=1) < 0.02 * dynamic.std(axis=1))


def test_measures_are_those_of_the_written_forces(rough):
    speed, x = SPEED_M_S, np.array([axle.x_m for axle in VEHICLE.axles])
    for i, force in enumerate(rough.tire_force_q50_N):
        place = speed * rough.time_s - x[i]
        on_road = force[(place >= 0.0) & (place <= 300.0)]
        assert rough.load_coefficient.q50[i] == pytest.approx(on_road.std() / on_road.mean(), rel=1e-6)
        assert rough.peak_ratio_q50[i] == pytest.approx(on_road.max() / STATIC_N[i], rel=1e-6)
        assert np.mean(on_road > rough.road.load_95_N.q50[i]) == pytest.approx(0.05, abs=2e-3)
        assert rough.road.road_stress.q50[i] == pytest.approx(np.mean((on_road / STATIC_N[i]) ** 4), rel=1e-5)
        # A normal load: 1 + 6 s^2 + 3 s^4 (Eisenmann).
        s = rough.load_coefficient.q50[i]
        assert rough.road.road_stress.q50[i] == pytest.approx(1 + 6 * s**2 + 3 * s**4, rel=0.03)
    assert rough.road.road_class == "C"
    assert rough.road.vehicle_stress.q50[0] > 1.0
    assert rough.road.aggregate_95.q50[0] > rough.road.vehicle_stress.q50[0]


def test_a_road_twice_as_rough_loads_twice_as_much(state, driven):
    """The same gentle road, and twice as high."""
    height = class_road("A", 200.0, 5)[1].mean(axis=0)
    a, b = (
        over(state, driven, RoadCourse(200.0, step_m=STATION_STEP_M, height_m=k * height, source=f"{k}"))
        for k in (1, 2)
    )
    np.testing.assert_allclose(b.load_coefficient.q50, 2.0 * a.load_coefficient.q50, rtol=0.03)
    assert b.road.roughness_index_mm_m == pytest.approx(2.0 * a.road.roughness_index_mm_m)


def test_several_realisations_are_pooled(state, driven):
    each = [over(state, driven, RoadCourse(100.0, "B", seed)) for seed in (4, 5)]
    both = over(state, driven, RoadCourse(100.0, "B", 4, realisations=2))
    peaks = np.max([p.peak_ratio_q50 for p in each], axis=0)
    np.testing.assert_allclose(both.peak_ratio_q50, peaks, rtol=1e-6)
    squares = np.mean([p.load_coefficient.q50**2 for p in each], axis=0)
    np.testing.assert_allclose(both.load_coefficient.q50, np.sqrt(squares), rtol=0.01)
    np.testing.assert_allclose(both.tire_force_q50_N, each[0].tire_force_q50_N, rtol=1e-6)


def test_draws_have_bands(state, driven):
    sets = state.point.log_parameters + 0.05 * np.random.default_rng(2).normal(
        size=(25, state.point.log_parameters.size)
    )
    banded = over(state, driven, RoadCourse(60.0, "B", 1), sets)
    assert np.all(banded.peak_ratio_q05 < banded.peak_ratio_q50)
    assert np.all(banded.load_coefficient.q95 > banded.load_coefficient.q50)
    one = over(state, driven, RoadCourse(60.0, "B", 1), sets[22:23])
    assert np.all(one.load_coefficient.q50 < banded.load_coefficient.q95 * 1.1)
    assert banded.tire_force_q95_N.shape == banded.tire_force_q50_N.shape


def test_groups_of_draws_side_by_side_are_those_one_after_the_other(state, driven, monkeypatch):
    """Measures are of all draws, bands of the first ones."""
    values = state.point.log_parameters
    sets = values + 0.05 * np.random.default_rng(3).normal(size=(45, values.size))
    course = RoadCourse(20.0, "C", 5)
    together = over(state, driven, course, sets)
    monkeypatch.setattr(road_loads, "_MOST_BYTES", 1.0)
    alone, first = over(state, driven, course, sets), over(state, driven, course, sets[: road_loads.BAND_DRAWS])
    for name in ("tire_force_q95_N", "peak_ratio_q95"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
    np.testing.assert_array_equal(together.road.aggregate_N, alone.road.aggregate_N)
    np.testing.assert_array_equal(together.tire_force_q95_N, first.tire_force_q95_N)
    assert np.abs(together.peak_ratio_q95 / first.peak_ratio_q95 - 1.0).max() > 1e-6


def test_a_road_that_takes_an_hour_is_refused(state, driven, monkeypatch):
    monkeypatch.setattr(limits, "ROAD_SECONDS", 20.0)
    with pytest.raises(CampaignError, match="choose a higher speed or a shorter road"):
        over(state, driven, RoadCourse(300.0, "C", 3))
