"""Predicted axle loads: conventions of time, static passes, bands, and what is said about extrapolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import AXLES, EMPTY, LADEN, STIFFNESS, VEHICLE, bump, campaign, empty_run, true_log_parameters

from sysid.campaign.records import BumpShape, Campaign, PredictionRequest
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.export.naming import prediction_files
from sysid.prediction import predict_passes
from sysid.prediction.measures import load_coefficient, quantiles
from sysid.prediction.predict_passes import effective_roads, predict, predict_pass, speed_sweep
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.remarks import edges, remarks
from sysid.prediction.trust import Extrapolation
from sysid.road.road_profile import RoadProfile
from sysid.road.shapes import make_profile, raised_cosine
from sysid.vehicle_model.passes import EffectiveRoads

SPEED_M_S = 10.0
REQUEST = PredictionRequest("empty", SPEED_M_S)
PROFILE = bump()
STATIC_N = np.array(EMPTY.axle_loads_kg) * VEHICLE.gravity_m_s2


def felt(data: Campaign, profile: RoadProfile = PROFILE) -> EffectiveRoads:
    """What the wheels feel of one bump, by the default contact law and declared tires."""
    return EffectiveRoads(VEHICLE, data.load_cases, {"bump": profile})


def fitted(data: Campaign, parameters: ParameterSet, values: np.ndarray) -> FitState:
    """A fit that ended at given values."""
    model = bump_model(data, parameters, {"bump": PROFILE})
    scale = np.ones((1, len(model.layout.sensors)))
    motion = RunMotion.steady(np.array([SPEED_M_S]), np.array([0.5]))
    return state_at(data, model, values, motion, Weights((scale,), (scale,)))


@pytest.fixture(scope="module")
def data() -> Campaign:
    return campaign([empty_run("a.csv", 9.0)], predictions=[REQUEST])


@pytest.fixture(scope="module")
def parameters(data):
    return campaign_parameters(data, None)


@pytest.fixture(scope="module")
def truth(parameters) -> np.ndarray:
    return true_log_parameters(parameters.names)


@pytest.fixture(scope="module")
def single(data, parameters, truth) -> PassPrediction:
    return predict_pass(data, parameters, felt(data), REQUEST, truth[None])


@pytest.fixture(scope="module")
def draws(truth) -> np.ndarray:
    return truth + 0.05 * np.random.default_rng(1).normal(size=(3, truth.size))


@pytest.fixture(scope="module")
def banded(data, parameters, truth, draws) -> PassPrediction:
    return predict_pass(data, parameters, felt(data), REQUEST, draws)


@pytest.mark.parametrize(("rise_m", "said"), [(0.0, True), (0.3, False)])
def test_edges_of_a_bump_are_said(data, parameters, truth, rise_m: float, said: bool):
    """A plank of 40 mm by 150 mm, and one that tires climb over 0.3 m; springs over the plank: 12 to 32 % off."""
    station = np.arange(0.0, 1.5 + 1e-9, 0.002)
    top = (station > 0.6 - 1e-9) & (station < 0.75 - 1e-9)
    climb = np.clip(np.minimum(station - 0.6 + rise_m, 0.75 + rise_m - station) / max(rise_m, 1e-9), 0.0, 1.0)
    height = 0.04 * (np.where(top, 1.0, 0.0) if rise_m == 0.0 else 0.5 - 0.5 * np.cos(np.pi * climb))
    words = edges(data, REQUEST, felt(data, make_profile(station, height)))
    assert bool(words) == said
    assert all("edges" in w and "of the static load" in w for w in words)
    found = predict_pass(data, parameters, felt(data, make_profile(station, height)), REQUEST, truth[None])
    assert set(words) <= set(found.warnings)


def test_a_pass_over_one_of_several_scans_names_it(data, parameters, truth, single):
    assert single.shape == ""
    two = replace(data, scans={"bump": None, "kerb": None})
    named = predict_pass(two, parameters, felt(data), REQUEST, truth[None])
    assert named.shape == "bump"
    files = prediction_files([named, replace(named, shape="kerb")])
    assert files == ("predictions/empty_36kmh_bump.csv", "predictions/empty_36kmh_kerb.csv")


def test_a_pass_over_a_flat_road_is_static(data, parameters, truth):
    """On the same stations, so that nothing is compiled anew."""
    flat = replace(PROFILE, height_m=0.0 * PROFILE.height_m)
    found = predict_pass(data, parameters, felt(data, flat), REQUEST, truth[None])
    np.testing.assert_allclose(found.tire_force_q50_N, np.tile(STATIC_N[:, None], found.time_s.size), rtol=1e-9)
    np.testing.assert_allclose(found.peak_ratio_q50, 1.0, rtol=1e-9)
    assert not found.lift_off.any()


def test_time_is_zero_when_axle_1_passes_the_start_of_the_bump(single, data):
    """Axle 1 feels the bump when its wheel is so near that the tread touches it: found from the tire alone."""
    first = EffectiveRoads(VEHICLE, data.load_cases, {"bump": PROFILE}).maps("empty", "bump")[0]
    touching = first.station_m[np.flatnonzero(np.abs(first.rise_m) > 1e-5)[0]]
    assert -0.4 < touching < 0.0
    force = single.tire_force_q50_N[0]
    moved = single.time_s[np.flatnonzero(np.abs(force / STATIC_N[0] - 1.0) > 2e-3)[0]]
    assert moved == pytest.approx(touching / SPEED_M_S, abs=0.003)
    assert 0.0 in single.time_s


def test_every_axle_meets_the_bump_later_by_its_distance(data, parameters, truth):
    """Over a bump so low that no wheel leaves it, the steepest rise of each force is its own climb."""
    low = replace(PROFILE, height_m=0.1 * PROFILE.height_m)
    found = predict_pass(data, parameters, felt(data, low), REQUEST, truth[None])
    assert not found.lift_off.any()
    slope = np.gradient(found.tire_force_q50_N, found.time_s, axis=1) / STATIC_N[:, None]
    steepest = found.time_s[np.argmax(slope, axis=1)]
    for i in (1, 2):
        assert steepest[i] - steepest[0] == pytest.approx(AXLES[i].x_m / SPEED_M_S, abs=0.01)


def test_the_record_covers_the_pass_in_milliseconds(single, data):
    maps = EffectiveRoads(VEHICLE, data.load_cases, {"bump": PROFILE}).maps("empty", "bump")
    touched = [m.station_m[np.flatnonzero(m.rise_m)[[0, -1]]] for m in maps]
    np.testing.assert_allclose(np.diff(single.time_s), 0.001, atol=1e-9)
    contact = touched[0][0] / SPEED_M_S
    leaving = (touched[2][1] + AXLES[2].x_m) / SPEED_M_S
    assert contact - 0.6 < single.time_s[0] <= contact - 0.5 + 1e-9
    assert leaving + 1.5 - 1e-9 <= single.time_s[-1] + 0.001 < leaving + 1.6
    assert single.tire_force_q50_N.shape == (3, single.time_s.size)
    np.testing.assert_allclose(single.tire_force_q50_N[:, :400], STATIC_N[:, None] * np.ones(400), rtol=1e-9)


def test_peak_ratio_and_lift_off_come_from_the_whole_pass(single):
    force = single.tire_force_q50_N
    np.testing.assert_allclose(single.static_load_N, STATIC_N)
    np.testing.assert_allclose(single.peak_ratio_q50, force.max(axis=1) / STATIC_N)
    np.testing.assert_array_equal(single.lift_off, force.min(axis=1) <= 0.0)
    assert single.lift_off.any()
    assert force.min() == 0.0
    assert (single.peak_ratio_q50 > 1.2).all()
    for unknown in ("tire_force_q05_N", "tire_force_q95_N", "peak_ratio_q05", "peak_ratio_q95"):
        assert getattr(single, unknown) is None


def test_impulse_of_the_wheel_loads_is_the_weight(single):
    """Over a pass that begins and ends at rest the mean total force carries the truck."""
    total = single.tire_force_q50_N.sum(axis=0)
    end = single.tire_force_q50_N[:, -1]
    np.testing.assert_allclose(end, STATIC_N, rtol=0.05)
    assert np.mean(total) == pytest.approx(STATIC_N.sum(), rel=5e-3)


def test_bands_are_quantiles_over_the_draws(data, parameters, single, banded, draws):
    alone = [predict_pass(data, parameters, felt(data), REQUEST, d[None]) for d in draws]
    force = np.stack([p.tire_force_q50_N for p in alone])
    np.testing.assert_allclose(banded.tire_force_q50_N, np.median(force, axis=0), rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(banded.tire_force_q05_N, np.quantile(force, 0.05, axis=0), rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(banded.tire_force_q95_N, np.quantile(force, 0.95, axis=0), rtol=1e-9, atol=1e-3)
    peaks = np.stack([p.peak_ratio_q50 for p in alone])
    # Quantiles of the peaks, not peaks of the quantiles.
    np.testing.assert_allclose(banded.peak_ratio_q95, np.quantile(peaks, 0.95, axis=0), rtol=1e-9)
    np.testing.assert_allclose(banded.peak_ratio_q50, np.median(peaks, axis=0), rtol=1e-9)
    np.testing.assert_array_equal(banded.time_s, single.time_s)


def test_draws_that_are_all_alike_have_no_band(data, parameters, truth, single):
    found = predict_pass(data, parameters, felt(data), REQUEST, np.tile(truth, (3, 1)))
    for band in (found.tire_force_q05_N, found.tire_force_q50_N, found.tire_force_q95_N):
        np.testing.assert_allclose(band, single.tire_force_q50_N, rtol=1e-9, atol=1e-3)


@pytest.fixture
def recorded(monkeypatch) -> list[np.ndarray]:
    """The sets of parameters that reach each pass, without simulating it."""
    seen: list[np.ndarray] = []

    def stand_in(campaign, parameters, roads, request, sets, vehicles=None, driven=None, stops=None):
        seen.append(sets)
        return request

    monkeypatch.setattr(predict_passes, "predict_pass", stand_in)
    return seen


def test_all_requests_are_predicted_from_a_seeded_selection_of_draws(data, parameters, truth, recorded):
    two = replace(data, predictions=(REQUEST, PredictionRequest("empty", 12.0)))
    many = truth + np.arange(1000.0)[:, None]
    state = fitted(two, parameters, truth)
    found = predict(state, many, two.predictions, seed=4, sweep_km_h=())
    assert found.source == "posterior"
    assert found.passes == two.predictions
    assert recorded[0].shape == (predict_passes.DRAWS, truth.size)
    np.testing.assert_array_equal(recorded[0], recorded[1])
    assert len({float(d[0]) for d in recorded[0]}) == predict_passes.DRAWS
    predict(state, many, two.predictions, seed=4, sweep_km_h=())
    np.testing.assert_array_equal(recorded[0], recorded[2])
    predict(state, many, two.predictions, seed=5, sweep_km_h=())
    assert not np.array_equal(recorded[0], recorded[4])


def test_without_a_posterior_the_source_is_least_squares(data, parameters, truth, recorded):
    state = fitted(data, parameters, truth)
    assert predict(state, None, data.predictions, sweep_km_h=()).source == "least squares"
    (sets,) = recorded
    np.testing.assert_array_equal(sets, truth[None])


def test_extrapolation_is_said():
    runs = campaign([empty_run("a.csv", 9.0)], load_cases=(EMPTY, LADEN))
    quiet = ()
    slow = remarks(runs, PredictionRequest("empty", 9.2), quiet, 1.0)
    fast = remarks(runs, PredictionRequest("empty", 12.0), quiet, 1.0)
    other = remarks(runs, PredictionRequest("laden", 9.0), quiet, 1.0)
    assert slow == ()
    assert "faster than any run" in fast[0]
    assert "43.2 km/h" in fast[0]
    assert "no run was driven in this load case" in other[0]
    far = (Extrapolation("damper_speed", 1, 2.0, 1.2), Extrapolation("travel", 1, 0.05, 0.031))
    damper, travel = sorted(remarks(runs, PredictionRequest("empty", 9.0), far, 1.0))
    assert "damper speed goes beyond the driven runs: axle 2 2 m/s (driven 1.2 m/s)" in damper
    assert "suspension travel goes beyond the driven runs: axle 2 50 mm (driven 31 mm)" in travel
    (lifted,) = remarks(runs, PredictionRequest("empty", 9.0), (Extrapolation("lift_off", 0, 0.02, 0.0),), 1.0)
    assert "never did in the driven runs: axle 1" in lifted
    (shaped,) = remarks(runs, PredictionRequest("empty", 9.0, "x", BumpShape("watts", 0.1, 3.7)), quiet, 1.0)
    assert "no run crossed this bump" in shaped
    two = replace(runs, scans={"bump": None, "kerb": None})
    (elsewhere,) = remarks(two, PredictionRequest("empty", 9.0, "kerb"), quiet, 1.0)
    assert elsewhere.startswith("empty, 32.4 km/h, kerb: no run crossed this bump")
    assert remarks(two, PredictionRequest("empty", 9.0, "bump"), quiet, 1.0) == ()
    (heavy,) = remarks(runs, PredictionRequest("empty", 9.0), quiet, 1.02)
    assert "1.020 times the weight" in heavy


def test_measures_of_a_pass_come_from_its_histories(single, banded, data):
    """Recomputed from the forces: time off the ground, mean over static load; the point estimate has no band."""
    force = single.tire_force_q50_N
    assert single.lift_off_s.q05 is None
    np.testing.assert_allclose(single.lift_off_s.q50, np.sum(force <= 0.0, axis=1) * 1e-3, rtol=1e-12)
    np.testing.assert_allclose(single.impulse_ratio.q50, force.mean(axis=1) / STATIC_N, rtol=1e-12)
    relative = force / STATIC_N[:, None] - 1.0
    maps = EffectiveRoads(VEHICLE, data.load_cases, {"bump": PROFILE}).maps("empty", "bump")
    for i in range(3):
        # From first contact until 1.5 s after the wheel has left the bump.
        touched = maps[i].station_m[np.flatnonzero(maps[i].rise_m)[[0, -1]]]
        begin, end = (touched + AXLES[i].x_m) / SPEED_M_S
        window = (single.time_s >= begin) & (single.time_s <= end + 1.5)
        expected = np.sqrt(np.mean(relative[i, window] ** 2))
        # The table of the bump begins and ends a little before and after the contact: 5 % for this short window.
        assert single.load_coefficient.q50[i] == pytest.approx(expected, rel=0.1)
    assert np.all(banded.load_coefficient.q05 <= banded.load_coefficient.q95)


def test_impulse_of_every_wheel_is_its_static_load(single):
    """A truck at rest before and after leaves no momentum in the road."""
    np.testing.assert_allclose(single.impulse_ratio.q50, 1.0, atol=0.005)


def test_suspension_and_axle_weight_balance_the_tire(single):
    """At rest exactly, in motion as far as the axle's inertia goes."""
    at_rest = single.suspension_force_N.q50[:, 0]
    weight = np.array([a.unsprung_mass_kg for a in AXLES]) * VEHICLE.gravity_m_s2
    np.testing.assert_allclose(at_rest + weight, STATIC_N, rtol=1e-9)
    # Averaged over half a second the axle's own inertia is small: the suspension carries what the tire carries more.
    window = np.ones(500) / 500
    for i in range(3):
        tire = np.convolve(single.tire_force_q50_N[i] - STATIC_N[i], window, "valid")
        suspension = np.convolve(single.suspension_force_N.q50[i] - at_rest[i], window, "valid")
        assert np.corrcoef(tire, suspension)[0, 1] > 0.6


def test_travel_is_within_what_the_suspension_force_says(single):
    """Where the extension turns only the spring pulls: the force reaches k times the travel either way."""
    force = single.suspension_force_N.q50 - single.suspension_force_N.q50[:, :1]
    assert (force.max(axis=1) >= STIFFNESS * single.jounce_m.q50 - 20.0).all()
    assert (force.min(axis=1) <= -STIFFNESS * single.rebound_m.q50 + 20.0).all()
    assert (single.jounce_m.q50 > 0.01).all()
    assert (single.rebound_m.q50 > 0.01).all()


def test_load_coefficient_of_a_sine_is_its_amplitude_over_root_two():
    time = np.arange(1000) * 1e-3
    force = 100.0 * (1.0 + 0.3 * np.sin(2.0 * np.pi * 5.0 * time))[:, None, None] * np.ones((1, 2, 1))
    passing = np.ones((1000, 2), bool)
    passing[500:, 1] = False
    force[500:, 1] = 1e5
    found = load_coefficient(force, np.array([[100.0], [100.0]]), passing)
    np.testing.assert_allclose(found[:, 0], 0.3 / np.sqrt(2.0), rtol=1e-9)


def test_ratio_against_speed_is_that_of_single_passes(data, parameters, truth, single, monkeypatch):
    roads = EffectiveRoads(VEHICLE, data.load_cases, {"bump": PROFILE})
    # Its longer interval misses little of a peak.
    usual = speed_sweep(data, parameters, "empty", "bump", roads, truth[:, None], [SPEED_M_S])
    np.testing.assert_allclose(usual.peak_ratio.q50[0], single.peak_ratio_q50, rtol=2e-3)
    np.testing.assert_allclose(usual.load_coefficient.q50[0], single.load_coefficient.q50, rtol=5e-3)
    monkeypatch.setattr(predict_passes, "SWEEP_INTERVAL_S", predict_passes.STEP_S)
    monkeypatch.setattr(predict_passes, "SWEEP_LENGTHS", ())
    found = speed_sweep(data, parameters, "empty", "bump", roads, truth[:, None], [SPEED_M_S])
    np.testing.assert_allclose(found.peak_ratio.q50[0], single.peak_ratio_q50, rtol=1e-12)
    np.testing.assert_allclose(found.load_coefficient.q50[0], single.load_coefficient.q50, rtol=1e-12)
    assert found.driven_m_s == (9.0, 9.0)
    assert found.extrapolated.tolist() == [True]
    assert replace(found, driven_m_s=(5.0, 9.6)).extrapolated.tolist() == [False]


def test_another_bump_by_its_shape_is_the_profile_itself(data, parameters, truth):
    """A named shape gives what its profile gives as a scanned bump."""
    shape = BumpShape("sinusoidal", 0.05, 0.8)
    request = PredictionRequest("empty", 10.0, shape.label, shape)
    roads = effective_roads(fitted(data, parameters, truth), [request])
    named = predict_pass(data, parameters, roads, request, truth[None])
    roads = felt(data, raised_cosine(0.05, 0.8))
    scanned = predict_pass(data, parameters, roads, PredictionRequest("empty", 10.0), truth[None])
    np.testing.assert_allclose(named.tire_force_q50_N, scanned.tire_force_q50_N, rtol=1e-12)
    assert named.shape == "sinusoidal 50 mm x 0.8 m"
    assert scanned.shape == ""
    # What is crossed is the same, by whatever name.
    assert (named.profile.name, scanned.profile.name) == ("sinusoidal 50 mm x 0.8 m", "bump")
    assert named.profile.sha256 == scanned.profile.sha256
    assert named.profile.height_m == pytest.approx(0.05)
    # Above 1 mm: h / 2 (1 - cos(2 pi s / L)) > 1 mm leaves arccos(0.96) L / (2 pi) at either end, less than a station.
    assert named.profile.length_m == pytest.approx(0.8 * (1.0 - np.arccos(0.96) / np.pi), abs=0.004)


@pytest.mark.parametrize("steps", [2, 5])
def test_histories_that_would_take_too_much_memory_keep_every_nth_step(
    data, parameters, draws, banded, steps, monkeypatch
):
    """Of the same simulation: integration steps do not change."""
    taken = 4 * 8 * len(draws) * len(VEHICLE.axles) * banded.time_s.size
    monkeypatch.setattr(predict_passes, "_MOST_BYTES", taken / (steps - 0.5))
    coarse = predict_pass(data, parameters, felt(data), REQUEST, draws)
    assert np.diff(coarse.time_s) == pytest.approx(0.001 * steps, abs=1e-9)
    assert 0.0 in coarse.time_s
    common, fine, kept = np.intersect1d(
        np.round(1e3 * banded.time_s).astype(int), np.round(1e3 * coarse.time_s).astype(int), return_indices=True
    )
    assert common.size >= coarse.time_s.size - 1
    for name in ("tire_force_q05_N", "tire_force_q50_N", "tire_force_q95_N"):
        whole, part = (getattr(found, name) for found in (banded, coarse))
        np.testing.assert_allclose(part[:, kept], whole[:, fine], rtol=1e-9)
    np.testing.assert_allclose(coarse.lift_off_s.q50, banded.lift_off_s.q50, atol=0.001 * steps)


def test_a_crawling_truck_comes_to_loads_that_no_longer_depend_on_the_speed(data, parameters, truth):
    """Those of a truck at rest on the bump. A truck that falls far behind its nominal place has none of them."""
    peaks = []
    for speed in (0.15, 0.3, 0.6):
        found = predict_pass(data, parameters, felt(data), replace(REQUEST, speed_m_s=speed), truth[None])
        assert found.time_s[-1] > 5.0 / speed
        peaks.append(found.peak_ratio_q50)
    np.testing.assert_allclose(peaks[0], peaks[1], rtol=0.004)
    np.testing.assert_allclose(peaks[1], peaks[2], rtol=0.025)


@pytest.mark.parametrize(("draws", "kind"), [(2, float), (7, float), (200, float), (200, np.float32)])
def test_quantiles_are_those_of_numpy(draws, kind):
    values = np.random.default_rng(draws).lognormal(size=(5, 3, draws)).astype(kind)
    values[1, 2, 0], values[3, 0] = np.nan, 1.5
    found = quantiles(values)
    expected = np.quantile(values.astype(float), [0.05, 0.5, 0.95], axis=-1)
    assert np.isnan(expected).sum() == 3
    np.testing.assert_allclose([found.q05, found.q50, found.q95], expected, rtol=1e-14)
