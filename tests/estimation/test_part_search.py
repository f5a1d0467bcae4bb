"""Rockers, bending frames and drives that nobody declared: found where there is one, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from rigid_truck import AXLES, DAMPING, EMPTY, LADEN, STIFFNESS, VEHICLE, bump, campaign, empty_run, with_values

from sysid.campaign.vehicle_records import AxleGroup, Equaliser, FrameBending, FrameMass
from sysid.estimation.fit import joint_optimum, law_choice, part_search
from sysid.estimation.fit.fit_result import LawComparison
from sysid.estimation.fit.frame_search import (
    LEAST_AMPLITUDE,
    TRIED_HZ,
    TRIED_RATIOS,
    frame_candidates,
    modal_mass_candidates,
)
from sysid.estimation.fit.joint_optimum import NEAR_SD
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.law_evidence import LawEvidence
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.part_score import PartCandidate, PartScore, _by_load_case, part_scores
from sysid.estimation.fit.part_search import undeclared_parts
from sysid.estimation.fit.rocker_search import joined_axles
from sysid.estimation.fit.state import restored
from sysid.estimation.fit.thresholds import DECISIVE, MISFIT
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.rockers import LoadShare, load_shares, share_from_fit
from sysid.estimation.parameters.undeclared_parts import NO_PARTS, Drive, UndeclaredParts
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.compressed import Compressed
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.residual_columns import difference_columns
from sysid.progress import unwatched
from sysid.vehicle_model.bending import frame_modes

SPEED_M_S, START_S = np.array([6.07, 8.39, 6.02]), np.array([0.44, 0.61, 0.5])
PROFILES = {"bump": bump()}
TANDEM = (Equaliser("tandem", (1, 2)),)


def measured(
    share: float,
    friction: float,
    bending_hz: float = 0.0,
    laden: FrameMass | None = None,
    drive: Drive | None = None,
):
    """A campaign of linear laws on a rigid frame without a rocker; its readings from a truck with one of these.

    `laden` says where the mass of its frame lies in the second load case, `drive` what held the speed.
    """
    linear = tuple(replace(a, suspension_law="linear", load_dependent=False) for a in AXLES)
    rubbing = tuple(replace(a, suspension_law="friction" if friction else "linear") for a in linear)
    runs = [empty_run("slow.csv", 6.0, samples=340), empty_run("fast.csv", 8.5, samples=340),
            empty_run("laden.csv", 6.0, load_case="laden", samples=340)]  # fmt: skip
    cases = (EMPTY, LADEN)
    true = replace(VEHICLE, axles=rubbing, equalisers=TANDEM if share else ())
    if bending_hz:
        true = replace(true, bodies=(replace(true.bodies[0], bending=FrameBending(bending_hz, 0.025)),))
    if drive is not None:
        true = replace(true, driven_at=drive.at, hold_s=drive.hold_s)
    true_cases = cases if laden is None else (EMPTY, replace(LADEN, frame_masses=(laden,)))
    behind = campaign(runs, load_cases=true_cases, vehicle=true)
    parameters = campaign_parameters(behind, None)
    truth = {"share_odds[tandem]": share / (1.0 - share) if share else 1.0}
    for i in range(3):
        truth |= {f"k_{i + 1}": STIFFNESS[i], f"c_{i + 1}": DAMPING[i], f"F_{i + 1}": friction}
    logs = np.log([truth.get(p.name, p.start) for p in parameters.parameters])
    model = bump_model(behind, parameters, PROFILES)
    random, filled = np.random.default_rng(11), {}
    for signals, group in zip(
        simulate_runs(model, logs, RunMotion.steady(SPEED_M_S, START_S)), model.groups, strict=True
    ):
        for position, r in enumerate(group.runs):
            clean = signals[: len(runs[r].log.channels[0].value), position]
            noise = np.array([2e-4 if c.sensor.kind == "suspension_deflection" else 0.1 for c in runs[r].log.channels])
            filled[r] = with_values(runs[r], clean + noise * random.normal(size=clean.shape))
    declared = campaign([filled[r] for r in range(3)], load_cases=cases, vehicle=replace(VEHICLE, axles=linear))
    return declared


OPTIONS = FitOptions(weight_rounds=1, second_solver=False, laws="declared")


def test_a_rocker_that_nobody_declared_is_named():
    fit, _ = fit_with_laws(measured(0.7, 0.0), None, PROFILES, OPTIONS)
    (found,) = fit.undeclared_rockers
    assert found.axles == (1, 2)
    assert found.share == pytest.approx(0.7, abs=0.05)
    assert "rocker shared" in fit.warnings[0]
    assert "Axles 2 and 3" in fit.warnings[0]
    # It is part of the model: springs and dampers are those of the truck.
    found_k = [p.value for p in fit.parameters if p.quantity == "stiffness"]
    assert found_k == pytest.approx(STIFFNESS, rel=0.02)


def test_a_declared_one_is_estimated_and_nothing_more_is_asked_for():
    data = measured(0.7, 0.0)
    fit, _ = fit_with_laws(replace(data, vehicle=replace(data.vehicle, equalisers=TANDEM)), None, PROFILES, OPTIONS)
    assert fit.undeclared_rockers == ()
    (share,) = fit.load_shares
    assert share.low < 0.7 < share.high
    assert share.high - share.low < 0.1


def test_friction_that_is_not_modelled_is_no_rocker():
    data = measured(0.0, 1500.0)
    fit, _ = fit_with_laws(data, None, PROFILES, OPTIONS)
    # There was reason to look: the vehicle as declared does not explain the readings. Departures do, friction is one.
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    assert optimum.misfit > MISFIT
    assert fit.undeclared_rockers == ()


@pytest.mark.parametrize(
    ("misfit", "gain", "end", "fitted"),
    [
        (1.31, 50.0, 5000.0, True),
        (1.31, 50.0, 4955.0, False),
        (1.2, 110.0, 5000.0, True),
        (1.2, 90.0, 5000.0, False),
    ],
)
def test_a_part_near_the_noise_has_to_explain_a_hundredth_of_the_residuals(misfit, gain, end, fitted, monkeypatch):
    """Twice the cost is 10,000 before it, and 100 less with it: enough to stay, unless going on finds it as well."""

    def stub(cost):
        problem = SimpleNamespace(forget=lambda: None)
        return SimpleNamespace(misfit=misfit, minimum=SimpleNamespace(cost=cost), problem=problem)

    part = PartCandidate("a part", NO_PARTS, NO_PARTS, 1.0, 0.1, lambda optimum: True)
    scores = [(PartScore(part, gain, 0.3),), ()]
    monkeypatch.setattr(part_search, "part_scores", lambda *unused: scores.pop(0))
    monkeypatch.setattr(part_search, "candidates_of", lambda campaign: ())
    monkeypatch.setattr(part_search, "effective_residuals", lambda optimum: 1000.0)
    better = stub(4950.0)
    monkeypatch.setattr(part_search, "_fitted", lambda *unused: better)
    monkeypatch.setattr(part_search, "_cost_at_end", lambda optimum: end)
    given = measured(0.0, 0.0), (), stub(5000.0), None, PROFILES, OPTIONS, unwatched
    _, optimum = undeclared_parts(*given, law_gain=lambda *unused: 0.0)
    assert (optimum is better) is fitted


def test_the_cost_at_the_end_of_a_search_is_that_of_the_linear_problem():
    random = np.random.default_rng(4)
    jacobian, residual = random.normal(size=(12, 3)), random.normal(size=12)
    problem = SimpleNamespace(compressed=lambda vector: Compressed(residual, jacobian), forget=lambda: None)
    optimum = SimpleNamespace(problem=problem, vector=None, minimum=SimpleNamespace(cost=0.5 * residual @ residual))
    left = residual - jacobian @ np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    assert part_search._cost_at_end(optimum) == pytest.approx(0.5 * left @ left, rel=1e-12)


def test_a_frame_that_nobody_declared_to_bend_is_part_of_the_fit():
    data = measured(0.0, 0.0, bending_hz=8.0)
    fit, state = fit_with_laws(data, None, PROFILES, OPTIONS)
    (found,) = fit.undeclared_frames
    assert found.body == VEHICLE.bodies[0].name
    assert found.frequency_hz == pytest.approx(8.0, rel=0.03)
    assert found.low < 8.0 < found.high
    assert "bends at 8" in fit.warnings[0]
    assert [p.value for p in fit.parameters if p.quantity == "stiffness"] == pytest.approx(STIFFNESS, rel=0.02)
    assert fit.undeclared_rockers == ()
    # What is kept of the fit brings the frame back.
    again = restored(data, PROFILES, state.point)
    assert again.campaign.vehicle == state.campaign.vehicle
    assert again.campaign.load_cases == state.campaign.load_cases
    problems = state.problem(), again.problem()
    signals = [simulate_runs(p.model, state.point.log_parameters, state.point.motion)[0] for p in problems]
    np.testing.assert_array_equal(*signals)


@pytest.mark.parametrize("time_s", [0.05, 0.4])
def test_wheels_that_hold_the_speed_are_part_of_the_fit(time_s):
    fit, state = fit_with_laws(measured(0.0, 0.0, drive=Drive("road", time_s)), None, PROFILES, OPTIONS)
    assert fit.undeclared_drive.at == "road"
    # Times are tried in steps of two, as long as another one explains a hundredth of what is left.
    assert fit.undeclared_drive.hold_s == pytest.approx(time_s, rel=0.6)
    assert "held by its wheels" in fit.warnings[0]
    assert [p.value for p in fit.parameters if p.quantity == "stiffness"] == pytest.approx(STIFFNESS, rel=0.02)
    assert fit.undeclared_rockers == fit.undeclared_frames == ()
    assert state.campaign.vehicle.driven_at == "road"


def test_a_truck_that_is_driven_as_declared_has_no_other_drive():
    fit, _ = fit_with_laws(measured(0.0, 0.0), None, PROFILES, OPTIONS)
    assert fit.undeclared_drive is None


#: Mass of a loaded frame that lies where the shape moves most: its frequency falls to half of the one assumed.
HEAVY = FrameMass(0.1, -0.15, 1.2)


def test_a_frame_is_found_whose_mass_under_load_lies_elsewhere():
    fit, state = fit_with_laws(measured(0.0, 0.0, 9.0, HEAVY), None, PROFILES, replace(OPTIONS, weight_rounds=2))
    (found,) = fit.undeclared_frames
    assert found.frequency_hz == pytest.approx(9.0, rel=0.01)
    assert [p.value for p in fit.parameters if p.quantity == "stiffness"] == pytest.approx(STIFFNESS, rel=0.015)
    # Shapes are no declared masses, which somebody could look up and correct.
    assert not any(m.quantity.startswith("frame") for m in fit.masses)
    (mass,) = state.point.parts.modal_masses
    assert mass.load_case == "laden"
    assert mass.log_factor == pytest.approx(HEAVY.log_modal_mass, abs=0.5)


def test_load_cases_may_show_different_frequencies():
    """By load case the score is larger, and the pair is near the truth: 9 Hz, and exp(-1.2 / 2) times that."""
    data = measured(0.0, 0.0, 9.0, HEAVY)
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    scores = part_scores(data, optimum, frame_candidates(data.vehicle))
    best = scores[0].candidate.unknown
    assert best.frames[0].bending.start_hz in (8.0, 9.0, 10.0)
    assert best.modal_masses[0].log_factor == pytest.approx(HEAVY.log_modal_mass, abs=0.5)
    alike = [s for s in scores if not s.candidate.unknown.modal_masses]
    assert scores[0].gain > 1.5 * alike[0].gain
    assert len(alike) == len(TRIED_HZ)


def test_other_frequencies_of_a_declared_frame_are_tried_in_further_load_cases():
    data = measured(0.0, 0.0, 9.0, HEAVY)
    bent = replace(data.vehicle, bodies=(replace(data.vehicle.bodies[0], bending=FrameBending(9.0, 0.025)),))
    declared = replace(data, vehicle=bent)
    optimum = optimise(declared, campaign_parameters(declared, None), PROFILES, OPTIONS, unwatched)
    best = part_scores(declared, optimum, modal_mass_candidates(declared))[0].candidate.unknown
    assert {c.unknown.modal_masses[0].load_case for c in modal_mass_candidates(declared)} == {"laden"}
    assert best.modal_masses[0].log_factor == pytest.approx(HEAVY.log_modal_mass, abs=0.5)
    assert modal_mass_candidates(data) == ()


def test_amplitudes_by_load_case_add_up_to_those_of_all_runs():
    data = measured(0.0, 0.0, 9.0)
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    problem, trials = optimum.problem, []
    for candidate in frame_candidates(data.vehicle)[2:5]:
        tried = candidate.tried.in_campaign(data)
        trials.append((problem.model.with_vehicle(tried.vehicle, tried.load_cases), 1.0))
    columns = difference_columns(problem.model, problem.model, problem.weights, *problem.unpack(optimum.vector), trials)
    evidence = LawEvidence(data, optimum)
    together, apart = evidence.without_known(optimum, columns).left, evidence.by_load_case(optimum, columns)
    np.testing.assert_allclose(apart.gradient.reshape(3, 2).sum(axis=1), together.gradient, rtol=1e-9)
    np.testing.assert_allclose(
        apart.matrix.reshape(3, 2, 3, 2).sum(axis=(1, 3)), together.matrix - np.eye(3), rtol=1e-9
    )


def test_scores_of_frames_on_rigid_trucks_are_small_and_of_bending_ones_are_largest_near_their_frequency():
    for data, bends in ((measured(0.0, 1500.0), False), (measured(0.0, 0.0, bending_hz=11.0), True)):
        optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
        scores = part_scores(data, optimum, frame_candidates(data.vehicle))
        assert (abs(scores[0].amplitude) > 2.0 * LEAST_AMPLITUDE) == bends
        if bends:
            assert scores[0].candidate.tried.frames[0].bending.frequency_hz in (10.0, 11.2, 12.5)
            assert scores[0].amplitude == pytest.approx(1.0, abs=0.6)


def test_frames_are_tried_on_bodies_that_are_declared_rigid():
    bent = replace(VEHICLE, bodies=(replace(VEHICLE.bodies[0], bending=FrameBending(8.0, 0.03)),))
    assert frame_candidates(bent) == ()
    assert [c.tried.frames[0].bending.frequency_hz for c in frame_candidates(VEHICLE)] == list(TRIED_HZ)


def test_a_part_that_explains_less_than_a_law_waits():
    data = measured(0.0, 0.0, bending_hz=8.0)
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    laws = tuple(frozenset[str]() for _ in data.vehicle.axles)
    given = (data, laws, optimum, None, PROFILES, OPTIONS, unwatched)
    parts, same = undeclared_parts(*given, law_gain=lambda *unused: 1e9)
    assert not parts
    assert same is optimum


class _Stub:
    """An optimum by name; what a fit is made of in the test below."""

    def __init__(self, name: str):
        self.name, self.misfit = name, 2.0
        self.problem = SimpleNamespace(model=SimpleNamespace(parameters=SimpleNamespace(names=())))


@pytest.mark.parametrize("late", [False, True])
def test_a_part_that_only_shows_beside_the_laws_lets_their_comparison_begin_again(monkeypatch, late):
    data, calls = measured(0.0, 0.0), []
    data = replace(data, vehicle=replace(data.vehicle, axles=tuple(replace(a, suspension_law=None) for a in AXLES)))
    part = UndeclaredParts(rockers=TANDEM)

    def found(campaign, laws, optimum, *rest, **how):
        calls.append(f"look beside {optimum.name}")
        # Beside the linear laws, or only beside the chosen ones; once.
        here = not campaign.vehicle.equalisers and (optimum.name == "chosen" if late else optimum.name == "fit 1")
        return (part, _Stub("with part")) if here else (NO_PARTS, optimum)

    def fitted(campaign, *rest, near=None, **how):
        calls.append("fit with rocker" if campaign.vehicle.equalisers else "fit")
        return _Stub(f"fit {sum(c.startswith('fit') for c in calls)}")

    def compared(campaign, *rest, **how):
        calls.append("compare with rocker" if campaign.vehicle.equalisers else "compare")
        return _Stub("chosen"), LawComparison((), ())

    class Ended(Exception):
        pass

    def ended(campaign, optimum, *rest):
        calls.append(f"end at {optimum.name}" + (" with rocker" if campaign.vehicle.equalisers else ""))
        raise Ended

    for name, stub in (("undeclared_parts", found), ("optimise", fitted), ("compare_laws", compared),
                       ("joint_optimum", ended), ("laws_at_optimum", lambda vehicle, optimum: ())):  # fmt: skip
        monkeypatch.setattr(law_choice, name, stub)
    with pytest.raises(Ended):
        fit_with_laws(data, None, PROFILES, FitOptions(second_solver=False))
    early = ["fit", "look beside fit 1", "fit with rocker", "compare with rocker", "look beside chosen"]
    later = ["fit", "look beside fit 1", "compare", "look beside chosen", "fit with rocker", "compare with rocker"]
    assert calls == [*(later if late else early), "end at chosen with rocker"]


def test_candidates_are_near_neighbours_under_one_body_that_nothing_joins():
    assert joined_axles(VEHICLE) == ((1, 2),)
    assert joined_axles(replace(VEHICLE, equalisers=TANDEM)) == ()
    assert joined_axles(replace(VEHICLE, groups=(AxleGroup("beam", (1, 2), 1.0, 1.0),))) == ()
    tridem = (AXLES[0], AXLES[1], AXLES[2], replace(AXLES[2], name="lift", x_m=6.9))
    assert joined_axles(replace(VEHICLE, axles=tridem)) == ((1, 2), (2, 3), (1, 2, 3))
    trailer = (*tridem[:3], replace(tridem[3], body=1))
    assert joined_axles(replace(VEHICLE, axles=trailer)) == ((1, 2),)


def test_shares_from_odds():
    """By hand: odds of 4 are a share of 0.8; a log sd of ln 2 / 1.645 reaches from odds 2 to 8."""
    found = share_from_fit("a", (1, 2), 4.0, np.log(2.0) / 1.6448536)
    assert (found.low, found.share, found.high) == pytest.approx((2 / 3, 0.8, 8 / 9), rel=1e-7)
    vehicle = replace(VEHICLE, equalisers=(Equaliser("a", (1, 2), 0.25),))
    assert load_shares(vehicle, ()) == (LoadShare("a", (1, 2), 0.25, 0.25, 0.25, declared=True),)


def test_frequencies_that_differ_by_load_case_have_to_be_worth_a_value_more():
    """Where runs and readings are independent of each other a gain is the sum of squares, less what a value costs."""
    low, high = frame_candidates(VEHICLE)[:2]
    pull = np.array([-3.0, -1.0, -1.0, -4.0])
    equations = NormalEquations(np.eye(4), pull, np.ones(4))
    (found,) = _by_load_case([low, high], equations, {"empty": 0, "laden": 1})
    assert found.gain == pytest.approx(3.0**2 + 4.0**2 - DECISIVE)
    assert found.amplitude == 3.0
    assert found.candidate.unknown.frames[0].bending.start_hz == TRIED_HZ[0]
    (mass,) = found.candidate.unknown.modal_masses
    assert mass.log_factor == pytest.approx(-2.0 * np.log(TRIED_HZ[1] / TRIED_HZ[0]))


def test_tried_modal_masses_move_the_frequency_under_load_to_the_share_that_they_stand_for():
    bent = replace(VEHICLE, bodies=(replace(VEHICLE.bodies[0], bending=FrameBending(9.0, 0.025)),))
    declared = replace(measured(0.0, 0.0, 9.0), vehicle=bent)

    def frequency_hz(of) -> float:
        cases = of.load_cases
        (mode,) = frame_modes(of.vehicle, cases["laden"], cases["empty"])
        return 9.0 * np.sqrt(mode.stiffness_mass / mode.modal_mass)

    found = [frequency_hz(c.unknown.in_campaign(declared)) for c in modal_mass_candidates(declared)]
    assert found == pytest.approx(np.array(TRIED_RATIOS) * frequency_hz(declared))


def test_shapes_of_frames_settle_before_other_masses_move(monkeypatch):
    """They may be far off: beside them a mass would take up what is due to the shape."""
    done, near = [], NEAR_SD / 2.0
    shapes = SimpleNamespace(masses=SimpleNamespace(undeclared=np.array([True])))
    steps = iter([("shapes", 5.0), ("shapes", near), ("all", 1.0), ("all", near), ("all", near)])

    def step(*unused, kind: str):
        name, largest = next(steps)
        assert name == kind
        taken = SimpleNamespace(largest=largest, kind=kind)
        taken.damped = lambda before: taken
        return taken

    def improved(campaign, optimum, taken, *rest, **how):
        done.append(taken.kind)
        return optimum

    monkeypatch.setattr(joint_optimum, "_allowances", lambda *unused: shapes)
    monkeypatch.setattr(joint_optimum, "_shape_step", partial(step, kind="shapes"))
    monkeypatch.setattr(joint_optimum, "_step", partial(step, kind="all"))
    monkeypatch.setattr(joint_optimum, "_improved", improved)
    monkeypatch.setattr(joint_optimum, "with_touched_stops", lambda campaign, optimum, *rest: optimum)
    start = SimpleNamespace(problem=SimpleNamespace(model=None))
    assert joint_optimum.joint_optimum(None, start, PROFILES, OPTIONS, unwatched) is start
    assert done == ["shapes", "shapes", "all", "all", "all"]
