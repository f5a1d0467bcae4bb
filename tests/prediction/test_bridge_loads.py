"""Vehicles on bridges: six axles and a beam in one set of equations, several vehicles, given lines and modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coupled_truck import TRUCK, Beam, crossing
from independent_truck import IndependentTruck
from lowboy_fit import state_of
from scipy.stats import spearmanr

from sysid.campaign.bridges import BridgeCourse, BridgeDescription, GivenLine, GivenModes, Surface
from sysid.campaign.records import PredictionRequest
from sysid.campaign.roads import RoadCourse
from sysid.estimation.fit.state import FitState
from sysid.prediction.bridge_loads import APPROACH_M, APPROACH_S, BEHIND_M, GROWTH_S, BridgeVehicles, predict_bridge
from sysid.prediction.driven_range import driven_range
from sysid.prediction.predicted_passes import PassPrediction
from sysid.road.roughness import class_road

SPEED = 22.0


@pytest.fixture(scope="module")
def state() -> FitState:
    return state_of(TRUCK)


#: Further pairs of beam and surface.
REST = (("20 m", "B"), ("40 m", "A"), ("40 m", "B"))


@pytest.fixture(scope="module")
def driven(state):
    return driven_range(state)


def described(beam: Beam, **changes) -> BridgeDescription:
    return replace(
        BridgeDescription(
            "beam",
            (beam.length_m,),
            ("pinned", "pinned"),
            (beam.stiffness_N_m2,),
            (beam.mass_kg_m,),
            (beam.damping_ratio,),
            beam.modes,
            (0.5 * beam.length_m,),
        ),
        **changes,
    )


def over(state, driven, course: BridgeCourse, speed: float = SPEED, sets: np.ndarray | None = None) -> PassPrediction:
    sets = state.point.log_parameters[None] if sets is None else sets
    request = PredictionRequest("laden", speed, course.label, bridge=course)
    return predict_bridge(BridgeVehicles(state, sets, None, None), request, driven)


#: 20 m at 5.6 Hz and 40 m at 2.6 Hz, as heavy as road bridges are.
BEAMS = {
    "20 m": Beam(20.0, 1.1e10, 10000.0, 0.015, 8),
    "40 m": Beam(40.0, 8.0e10, 14000.0, 0.01, 8),
}


def in_one_set(beam: Beam, road: str, times: np.ndarray, *, feels_deck: bool = True) -> dict[str, np.ndarray]:
    """The hand-written equations over the road of a class that the package drives."""
    end = beam.length_m + TRUCK.x_m[-1] + BEHIND_M
    station, tracks = class_road(road, APPROACH_M + end, 3)
    lead = 0.002 * np.ceil(min(APPROACH_M, APPROACH_S * SPEED) / SPEED / 0.002) * SPEED
    share = np.clip((station - (APPROACH_M - lead)) / min(GROWTH_S * SPEED, 0.5 * APPROACH_M), 0.0, 1.0)
    grown = share**4 * (35.0 - share * (84.0 - share * (70.0 - 20.0 * share)))
    # Heights count from where the truck begins.
    height = tracks.mean(axis=0)
    height = (height - np.interp(APPROACH_M - lead, station, height)) * grown
    return crossing(beam, station - APPROACH_M, height, SPEED, -lead, times, feels_deck=feels_deck)


@pytest.mark.parametrize(
    ("name", "road"), [("20 m", "A"), *(pytest.param(n, r, marks=pytest.mark.long) for n, r in REST)]
)
def test_six_axles_on_a_beam_in_one_set_of_equations(state, driven, name: str, road: str):
    beam = BEAMS[name]
    surface = Surface(RoadCourse(0.0, road, 3, 1), 0.0)
    found = over(state, driven, BridgeCourse(described(beam), surface))
    loads = found.bridge
    exact = in_one_set(beam, road, loads.time_s)
    for k, kind in enumerate(loads.names):
        word = kind.split()[0]
        if not kind.endswith(f"at {0.5 * beam.length_m:g} m"):
            continue
        size = np.abs(exact[word]).max()
        # Shear jumps where an axle is at the section.
        clear = (np.abs(SPEED * loads.time_s[:, None] - np.array(TRUCK.x_m) - 0.5 * beam.length_m) > 0.01).all(axis=1)
        assert np.abs(loads.history.q50[k] - exact[word])[clear].max() < 0.01 * size
        if word == "shear":
            continue
        effect = next(e for e in loads.effects if e.line == k and e.sense == "largest")
        assert effect.dynamic.q50[0] == pytest.approx(exact[word].max(), rel=0.01)
        # A truck that does not feel the deck: the dynamic axle loads of the rigid road on the same modes.
        assert effect.rolling.q50[0] != pytest.approx(exact[word].max(), rel=0.01)
    common = np.isin(np.round(loads.time_s, 6), found.time_s)
    at = np.searchsorted(found.time_s, np.round(loads.time_s[common], 6))
    error = found.tire_force_N.q50[:, at].T - exact["tire"][common]
    assert np.sqrt(np.mean(error**2)) < 0.004 * exact["tire"].mean()


@pytest.mark.long
def test_a_truck_that_does_not_feel_the_deck_is_seen(state, driven):
    beam = BEAMS["20 m"]
    found = over(state, driven, BridgeCourse(described(beam), Surface(RoadCourse(0.0, "A", 3, 1), 0.0)))
    exact = in_one_set(beam, "A", found.bridge.time_s, feels_deck=False)["moment"]
    assert np.abs(found.bridge.history.q50[0] - exact).max() > 0.01 * exact.max()


def effect(loads, word: str, sense: str = "largest"):
    return next(e for e in loads.effects if e.name.startswith(word) and e.sense == sense)


def test_a_slow_truck_is_at_rest(state, driven):
    """At walking speed over a level bridge: the influence line by hand, no amplification, codes beside it."""
    beam = Beam(30.0, 3e11, 20000.0, 0.02, 4)
    loads = over(state, driven, BridgeCourse(described(beam)), speed=2.0).bridge
    static = np.array(TRUCK.load_cases["laden"][0]) * 9.81
    place = np.arange(0.0, 50.0, 0.001)[:, None] - np.array(TRUCK.x_m)
    hand = (np.clip(np.minimum(place, 30.0 - place), 0.0, None) / 2) @ static
    moment = effect(loads, "moment")
    assert moment.static.q50[0] == pytest.approx(hand.max(), rel=1e-4)
    assert moment.front_m == pytest.approx(place[hand.argmax(), 0], abs=0.3)
    assert moment.amplification.q50[0] == pytest.approx(1.0, abs=0.01)
    assert moment.amplification.q05 is None
    code = {c.model: c.value for c in moment.codes}
    assert code["LM1"] == pytest.approx(1e3 * (600 * (7.5 - 0.3) + 27 * 900 / 8), rel=1e-5)
    # Concurrent shear at mid-span has the sign and size of the axles about it, no more than all of them.
    names = loads.names
    assert moment.concurrent[names.index(moment.name)] == pytest.approx(moment.dynamic.q50[0], rel=1e-9)
    assert abs(moment.concurrent[names.index("shear at 15 m")]) < 0.5 * static.sum()


def test_one_vehicle_behind_the_other(state, driven):
    """Two trucks so far apart that they never meet on the bridge do what one does; close ones do more."""
    beam = BEAMS["20 m"]
    one, far, near = (
        effect(over(state, driven, BridgeCourse(described(beam), None, n, gap)).bridge, "moment")
        for n, gap in ((1, 10.0), (2, 400.0), (2, 3.0))
    )
    assert far.static.q50[0] == pytest.approx(one.static.q50[0], rel=1e-9)
    assert far.dynamic.q50[0] == pytest.approx(one.dynamic.q50[0], rel=2e-3)
    assert near.static.q50[0] > 1.05 * one.static.q50[0]


def test_given_lines_and_modes_are_those_of_the_beam(state, driven):
    """The same bridge as spans, and as influence lines and modes that another program would give."""
    beam = BEAMS["20 m"]
    spans = over(state, driven, BridgeCourse(described(beam))).bridge
    s = np.linspace(0.0, beam.length_m, 401)
    n = np.arange(1, beam.modes + 1)
    half = 0.5 * beam.length_m
    shear = np.concatenate([-s[:201], beam.length_m - s[200:]]) / beam.length_m
    lines = (
        GivenLine("moment mid", "moment", s, np.minimum(s, beam.length_m - s) / 2),
        GivenLine("shear mid", "shear", np.insert(s, 200, half), shear),
    )
    modes = GivenModes(
        s,
        np.sin(np.multiply.outer(s, n * np.pi / beam.length_m)),
        beam.omega / (2 * np.pi),
        np.full(n.size, 0.5 * beam.mass_kg_m * beam.length_m),
    )
    description = BridgeDescription(
        "given", mass_kg_m=(beam.mass_kg_m,), damping_ratio=(beam.damping_ratio,), lines=lines, given_modes=modes
    )
    given = over(state, driven, BridgeCourse(description)).bridge
    for word in ("moment", "shear"):
        for name in ("static", "dynamic"):
            found, wanted = (getattr(effect(loads, word), name).q50[0] for loads in (given, spans))
            assert found == pytest.approx(wanted, rel=2e-3)
    alone = replace(description, lines=())
    deflection = effect(over(state, driven, BridgeCourse(alone)).bridge, "deflection at 10")
    assert deflection.dynamic.q50[0] == pytest.approx(effect(spans, "deflection").dynamic.q50[0], rel=2e-3)
    still = over(state, driven, BridgeCourse(replace(description, given_modes=None)))
    assert "no modes" in still.warnings[-1]
    assert effect(still.bridge, "moment").dynamic == effect(still.bridge, "moment").rolling


def test_draws_and_surfaces_make_the_band(state, driven):
    """Four draws with softer and two with harder springs, three surfaces: the band is that of all passes by themselves.

    The first four show the others where to begin.
    """
    beam = BEAMS["20 m"]
    sets = np.stack([state.point.log_parameters] * 6)
    stiff = [k for k, name in enumerate(state.parameters.names) if name.startswith("k_")]
    sets[4:, stiff] += np.log(2.0)
    three = Surface(RoadCourse(0.0, "B", 0, 3), 0.0)
    both = effect(over(state, driven, BridgeCourse(described(beam), three), sets=sets).bridge, "moment")
    single = [
        effect(over(state, driven, BridgeCourse(described(beam), Surface(RoadCourse(0.0, "B", k), 0.0)),
                    sets=one[None]).bridge, "moment").dynamic.q50[0]
        for k in range(3) for one in sets[3:5]
    ]  # fmt: skip
    single = np.repeat(single, (4, 2) * 3)
    for q, name in ((0.05, "q05"), (0.5, "q50"), (0.95, "q95")):
        assert getattr(both.dynamic, name)[0] == pytest.approx(np.quantile(single, q), rel=1e-3)


def loaded(share: float, random: np.random.Generator) -> IndependentTruck:
    """A truck of the kind with that share of the sprung masses, and with suspensions of its own."""
    loads, sprung, inertia, height = (np.array(v) for v in TRUCK.load_cases["laden"])
    unsprung = np.array(TRUCK.unsprung_kg)
    case = tuple(map(tuple, (unsprung + share * (loads - unsprung), share * sprung, share * inertia, height)))
    factor = random.lognormal(0.0, 0.15, (2, 6))
    return replace(
        TRUCK,
        load_cases={"laden": case},
        stiffness=tuple(np.array(TRUCK.stiffness) * factor[0]),
        damping=tuple(np.array(TRUCK.damping) * factor[1]),
    )


@pytest.mark.long
def test_amplification_falls_with_weight():
    """Twenty trucks of 17 to 40 t over three surfaces: the sign that was measured in ARCHES (deliverable D10, 2009)."""
    random, beam = np.random.default_rng(3), BEAMS["20 m"]
    course = BridgeCourse(described(beam), Surface(RoadCourse(0.0, "C", 0, 3), 0.0))
    weight, amplification = [], []
    for share in np.linspace(0.35, 1.0, 20):
        one = state_of(loaded(share, random))
        found = effect(over(one, driven_range(one), course).bridge, "moment")
        weight.append(sum(one.campaign.load_cases["laden"].axle_loads_kg))
        amplification.append(found.amplification.q50[0])
    assert spearmanr(weight, amplification).statistic < -0.3
