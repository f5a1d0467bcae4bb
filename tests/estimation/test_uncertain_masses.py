"""Tolerances of declared masses: against dense least squares with the masses free, and against optima found anew."""

from __future__ import annotations

from dataclasses import astuple, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import rigid_truck
from rigid_truck import EMPTY, LADEN, VEHICLE, campaign, empty_run
from scipy.optimize import lsq_linear
from synthetic_fit import synthetic_campaign

from sysid.campaign.vehicle_records import AxleGroup, FrameBending, FrameMass, LoadCase, MassTolerances, Vehicle
from sysid.errors import DataRejectedError
from sysid.estimation.fit import joint_optimum
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.minimiser import minimise
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.allowances import campaign_allowances
from sysid.estimation.uncertainty.joint_step import JointStep, bounded_step, joint_step
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.uncertain_masses import AXLE_LOAD, INERTIA, SCALE, uncertain_masses
from sysid.progress import unwatched
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.bending import ends_carry_mass, frame_modes

OPTIONS = FitOptions(weight_rounds=1, second_solver=False)
TOLERANT = replace(VEHICLE, tolerances=MassTolerances())


def linear_problem(seed: int = 1) -> tuple[np.ndarray, ...]:
    """Jacobian (rows, 3 + 2), residuals, prior precision of the parameters, tolerances."""
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(60, 5)) * np.array([3.0, 1.0, 2.0, 20.0, 9.0])
    return jacobian, random.normal(size=60), np.diag([0.5, 0.0, 2.0]), np.array([0.03, 0.05])


def test_one_step_reaches_the_joint_optimum_of_a_dense_problem():
    """From any point of a linear problem, against least squares with the masses as further unknowns."""
    jacobian, residual, prior, sd = linear_problem()
    root = np.sqrt(prior)
    free = np.concatenate([jacobian, np.eye(2, 5, 3) / sd[:, None], np.concatenate([root, np.zeros((3, 2))], axis=1)])
    joint = np.linalg.lstsq(free, -np.concatenate([residual, np.zeros(5)]), rcond=None)[0]
    here, amounts = np.array([0.1, -0.2, 0.05]), np.array([0.04, -0.01])
    score = jacobian.T @ (residual + jacobian @ np.concatenate([here, amounts]))
    step = joint_step(jacobian.T @ jacobian, score, prior, prior @ here, sd, amounts)
    np.testing.assert_allclose(np.concatenate([here + step.parameters, amounts + step.amounts]), joint, rtol=1e-9)
    spread = np.sqrt(np.diag(np.linalg.inv(free.T @ free)))[3:]
    assert step.largest == pytest.approx(np.max(np.abs(joint[3:] - amounts) / spread), rel=1e-9)
    # An exact mass stays where it is, and does not divide by zero.
    held = joint_step(jacobian.T @ jacobian, score, prior, prior @ here, np.array([0.03, 0.0]), amounts * [1.0, 0.0])
    assert held.amounts[1] == 0.0
    # One that is held away from zero, at a bound, is not on its way either.
    held = joint_step(jacobian.T @ jacobian, score, prior, prior @ here, np.array([0.03, 0.0]), amounts * [1.0, 1e6])
    assert held.amounts[1] == held.over_sd[1] == 0.0


def test_a_change_counts_in_the_least_deviation_that_matters():
    """One unknown with a scale of 1e-6 moves by its own deviation, a ten-thousandth of what matters; the mass counts as
    before."""
    jacobian, residual, prior, _ = linear_problem()
    sd, amounts = np.array([0.03, 1e-6]), np.array([0.0, 1e-6])
    arguments = jacobian.T @ jacobian, jacobian.T @ residual, prior, np.zeros(3), sd, amounts
    alone, counted = joint_step(*arguments), joint_step(*arguments, least_sd=np.array([0.0, 0.01]))
    np.testing.assert_array_equal(counted.amounts, alone.amounts)
    assert counted.over_sd[0] == alone.over_sd[0]
    # Back to zero, which the prior of 1e-6 asks for.
    assert alone.over_sd[1] == pytest.approx(-1.0, rel=3e-5)
    assert counted.over_sd[1] == pytest.approx(-1e-4, rel=3e-5)


def test_what_leaves_its_bound_only_when_another_is_held_is_held_too():
    """Both at zero and not to fall below: against bounded least squares.  The first step would move one of them up."""
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]])
    residual, sd, prior = np.array([1.0, 0.5, 1.0]), np.array([10.0, 10.0]), np.diag([0.5])
    step_with = partial(
        joint_step,
        jacobian.T @ jacobian,
        jacobian.T @ residual,
        prior,
        np.zeros(1),
        amounts=np.zeros(2),
    )
    first = step_with(sd)
    assert first.amounts[0] > 0.0 > first.amounts[1]
    step = bounded_step(step_with, sd, lambda step: step.amounts < 0.0)
    whole = np.concatenate([jacobian, np.diag([np.sqrt(0.5), 0.1, 0.1])])
    best = lsq_linear(whole, -np.concatenate([residual, np.zeros(3)]), ([-np.inf, 0.0, 0.0], np.inf)).x
    np.testing.assert_allclose(np.concatenate([step.parameters, step.amounts]), best, atol=1e-9)
    assert step.amounts.tolist() == [0.0, 0.0]
    assert step.largest == 0.0


def test_masses_integrated_out_leave_the_marginal_of_a_joint_gaussian():
    """Marginal precision, conditional mean and covariance, from the full precision matrix and its inverse."""
    jacobian, _, _, sd = linear_problem(3)
    information = jacobian.T @ jacobian
    joint = information + np.diag(np.concatenate([np.zeros(3), sd**-2.0]))
    equations, masses = NormalEquations.of(information, sd=sd), slice(3, None)
    left, follow = equations.eliminate(masses)
    factor = equations.only(masses).covariance_factor
    np.testing.assert_allclose(left.covariance, np.linalg.inv(joint)[:3, :3], rtol=1e-9)
    np.testing.assert_allclose(factor @ factor.T, np.linalg.inv(joint[3:, 3:]), rtol=1e-9)
    np.testing.assert_allclose(follow, -np.linalg.solve(joint[3:, 3:], joint[3:, :3]), rtol=1e-9)
    response = MassResponse(np.arange(3.0), follow, factor, np.array([0.01, -0.02]))
    points = np.tile(np.array([0.01, 0.98, 2.03]), (50_000, 1))
    drawn = response.draws(points, np.random.default_rng(4))
    spread = np.sqrt(np.diag(factor @ factor.T))
    mean = np.array([0.01, -0.02]) + follow @ [0.01, -0.02, 0.03]
    np.testing.assert_allclose(drawn.mean(axis=0) / spread, mean / spread, atol=0.02)
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(spread, spread), np.corrcoef(drawn.T), atol=0.02)


def test_factors_keep_axle_loads_and_total_mass():
    group = AxleGroup("bogie", (1, 2), 300.0, 90.0)
    vehicle = replace(TOLERANT, groups=(group,))
    cases = [replace(c, sprung_mass_kg=(c.sprung_mass_kg[0] - 300.0,)) for c in (EMPTY, LADEN)]
    runs = [empty_run("a.csv", 6.0), empty_run("b.csv", 6.0, load_case="laden")]
    masses = uncertain_masses(campaign(runs, vehicle=vehicle, load_cases=cases))
    assert [f.name for f in masses.factors] == [
        "unsprung_mass_1",
        "unsprung_mass_2",
        "unsprung_mass_3",
        "beam_mass[bogie]",
        "pitch_inertia[truck, empty]",
        "pitch_inertia[truck, laden]",
        "cg_height[truck, empty]",
        "cg_height[truck, laden]",
        *(f"axle_load_{i}[{case}]" for case in ("empty", "laden") for i in (1, 2, 3)),
        "axle_load_scale",
    ]
    np.testing.assert_allclose(masses.sd, [0.08] * 4 + [0.25] * 2 + [0.1] * 2 + [0.005] * 7)
    change = np.array([0.02, -0.03, 0.01, 0.05, 0.1, 0.0, 0.0, -0.06, *[0.0] * 7])
    found, loads = masses.applied(change)
    assert sum(found.unsprung_mass_kg) + loads["empty"].sprung_mass_kg[0] == pytest.approx(sum(EMPTY.axle_loads_kg))
    np.testing.assert_allclose(
        [a.unsprung_mass_kg for a in found.axles], [520 * np.exp(0.02), 980 * np.exp(-0.03), 760 * np.exp(0.01)]
    )
    assert found.groups[0].mass_kg == pytest.approx(300.0 * np.exp(0.05))
    assert loads["empty"].pitch_inertia_kg_m2[0] == pytest.approx(25000.0 * np.exp(0.1))
    assert loads["laden"].pitch_inertia_kg_m2 == LADEN.pitch_inertia_kg_m2
    assert loads["laden"].cg_height_m[0] == pytest.approx(1.55 * np.exp(-0.06))
    assert loads["laden"].axle_loads_kg == LADEN.axle_loads_kg
    assemble(found, loads["laden"])
    far, _ = masses.applied(np.full(15, 9.0))
    assert far.axles[0].unsprung_mass_kg == pytest.approx(520 * np.exp(0.32 + 0.02))


def test_what_a_scale_showed_wrongly_the_bodies_carry():
    runs = [empty_run("a.csv", 6.0), empty_run("b.csv", 6.0, load_case="laden")]
    masses = uncertain_masses(campaign(runs, vehicle=TOLERANT, load_cases=(EMPTY, LADEN)))
    names = [f.name for f in masses.factors]
    change = np.zeros(len(names))
    change[names.index("axle_load_2[laden]")] = 0.01
    change[names.index("axle_load_scale")] = -0.004
    vehicle, cases = masses.applied(change)
    # A truck of less weight is lighter in all parts.
    np.testing.assert_allclose(vehicle.unsprung_mass_kg, np.exp(-0.004) * np.array(TOLERANT.unsprung_mass_kg))
    assert cases["empty"].pitch_inertia_kg_m2[0] == pytest.approx(np.exp(-0.004) * EMPTY.pitch_inertia_kg_m2[0])
    loads = np.array(LADEN.axle_loads_kg) * np.exp(-0.004) * [1.0, np.exp(0.01), 1.0]
    np.testing.assert_allclose(cases["laden"].axle_loads_kg, loads, rtol=1e-12)
    np.testing.assert_allclose(cases["empty"].axle_loads_kg, np.array(EMPTY.axle_loads_kg) * np.exp(-0.004), rtol=1e-12)
    for case, declared in ((cases["laden"], LADEN), (cases["empty"], EMPTY)):
        gained = sum(case.axle_loads_kg) - sum(declared.axle_loads_kg)
        gained -= sum(vehicle.unsprung_mass_kg) - sum(TOLERANT.unsprung_mass_kg)
        assert case.sprung_mass_kg[0] - declared.sprung_mass_kg[0] == pytest.approx(gained, abs=1e-9)
        assemble(vehicle, case)
    # A heavier axle leaves what stands on the scale as it is.
    change[names.index("unsprung_mass_2")] = 0.1
    heavier, cases = masses.applied(change)
    assert heavier.unsprung_mass_kg[1] == pytest.approx(np.exp(0.096) * TOLERANT.unsprung_mass_kg[1], rel=1e-12)
    for name in ("empty", "laden"):
        standing = sum(cases[name].sprung_mass_kg) + sum(heavier.unsprung_mass_kg)
        assert standing == pytest.approx(sum(cases[name].axle_loads_kg), rel=1e-12)
        assemble(heavier, cases[name])


def test_load_cases_with_one_declared_value_share_its_factor_and_zero_switches_off():
    same = replace(LADEN, pitch_inertia_kg_m2=EMPTY.pitch_inertia_kg_m2)
    vehicle = replace(TOLERANT, tolerances=MassTolerances(0.0, 0.07, 0.0, 0.0, 0.0, 0.0))
    runs = [empty_run("a.csv", 6.0), empty_run("b.csv", 6.0, load_case="laden")]
    masses = uncertain_masses(campaign(runs, vehicle=vehicle, load_cases=(EMPTY, same)))
    (factor,) = masses.factors
    assert (factor.name, factor.sd, factor.load_case) == ("pitch_inertia[truck]", 0.07, None)
    assert uncertain_masses(campaign(runs, load_cases=(EMPTY, LADEN))).factors == ()


@pytest.fixture(scope="module")
def fits():
    """The small campaign fitted with declared masses, and with an unsprung mass declared 2 % too low."""
    data, parameters, profiles = synthetic_campaign()
    tolerant = replace(data, vehicle=TOLERANT)
    plain = fit_bump_runs(tolerant, parameters, profiles, OPTIONS)
    masses = uncertain_masses(tolerant)
    off = np.zeros(masses.sd.size)
    off[1] = 0.02
    vehicle, cases = masses.applied(off)
    moved = fit_bump_runs(replace(tolerant, vehicle=vehicle, load_cases=cases), parameters, profiles, OPTIONS)
    exact = fit_bump_runs(data, parameters, profiles, OPTIONS)
    return tolerant, plain, moved, exact, masses, off


def test_a_mass_that_is_off_within_its_tolerance_moves_k_and_c_little(fits):
    """With masses exact the same error moves c of that axle by more than one and a half per cent."""
    data, (plain, state), (moved, _), (exact, _), masses, off = fits
    assert exact.masses == ()
    assert state.point.amounts.size == state.allowances.count
    vehicle, cases = masses.applied(off)
    other = replace(data, vehicle=vehicle, load_cases=cases)
    model = bump_model(other, state.model.parameters, {"bump": rigid_truck.bump()}, tires=state.model.tires)
    problem = Problem(model, other, state.point.motion, state.point.weights)
    start = problem.vector(state.point.log_parameters)
    held = minimise(problem.evaluate, start, relative_tolerance=1e-8).point[: problem.count]
    k = list(plain.names).index("c_2")
    assert abs(held[k] - state.point.log_parameters[k]) > 0.015
    values, sd = (np.array([getattr(p, name) for p in plain.parameters]) for name in ("value", "sd"))
    change = np.array([p.value for p in moved.parameters]) - values
    wanted = [i for i, p in enumerate(plain.parameters) if p.quantity in ("stiffness", "damping")]
    assert np.abs(change[wanted] / sd[wanted]).max() < 0.3
    # The scale is not known better than that, so neither are k and c.
    assert np.all(sd[wanted] / values[wanted] > 0.8 * data.vehicle.tolerances.axle_load_scale)


def test_what_the_data_ask_for_is_what_the_masses_are(fits):
    _, (plain, state), (moved, _), _, masses, off = fits
    estimate = np.log([c.estimate for c in moved.masses])
    base = np.log([c.estimate for c in plain.masses])
    assert [c.name for c in plain.masses] == [f.name for f in masses.factors]
    # The data shrink what is known of that mass, to what the joint distribution says.
    assert plain.masses[1].sd < 0.3 * plain.masses[1].tolerance
    response, covariance = state.point.mass_response, plain.covariance
    draws = np.random.default_rng(5).multivariate_normal(response.centre, covariance, 20_000)
    scatter = response.draws(draws, np.random.default_rng(6)).std(axis=0)[1]
    assert plain.masses[1].sd == pytest.approx(scatter, rel=0.03)
    # Declared 2 % too high, the data ask for 2 % less than they do with the right value.
    assert estimate[1] - base[1] == pytest.approx(-off[1], abs=0.004)


def test_a_mass_far_from_what_the_data_ask_for_is_named():
    data, parameters, profiles = synthetic_campaign()
    # Weighed axles: 12 % are four times the tolerance; of a guess they would be no reason for a doubt.
    weighed = replace(VEHICLE, tolerances=MassTolerances(unsprung_mass=0.03))
    masses = uncertain_masses(replace(data, vehicle=weighed))
    wrong = np.zeros(masses.sd.size)
    wrong[2] = 0.12
    vehicle, cases = masses.applied(wrong)
    found, _ = fit_bump_runs(replace(data, vehicle=vehicle, load_cases=cases), parameters, profiles, OPTIONS)
    sentences = [w for w in found.warnings if "unsprung mass of axle 3 (tag)" in w]
    assert len(sentences) == 1
    assert "below the declared one" in sentences[0]


def test_matrices_are_assembled_again_as_for_a_vehicle_declared_so():
    runs = [empty_run("a.csv", 6.0, samples=150), empty_run("b.csv", 7.0, load_case="laden", samples=150)]
    data = campaign(runs, vehicle=TOLERANT, load_cases=(EMPTY, LADEN))
    parameters, profiles = campaign_parameters(data, None), {"bump": rigid_truck.bump()}
    model = bump_model(data, parameters, profiles)
    masses = uncertain_masses(data)
    # Loads as declared: maps of the footprint stay those of these loads.
    weighed = np.array([f.quantity in (AXLE_LOAD, SCALE) for f in masses.factors])
    vehicle, cases = masses.applied(np.where(weighed, 0.0, 0.5 * masses.sd))
    other = bump_model(replace(data, vehicle=vehicle, load_cases=cases), parameters, profiles)
    motion = RunMotion.steady(np.array([6.0, 7.0]), np.array([0.2, 0.2]))
    x = parameters.start
    for ours, theirs in zip(
        simulate_runs(model.with_vehicle(vehicle, cases), x, motion), simulate_runs(other, x, motion), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def test_a_truck_with_all_masses_loads_and_stiffnesses_a_little_larger_moves_in_the_same_way():
    """What no data can tell: the scale.  Held by footprints that follow the loads; without that the motion differs."""
    runs = [empty_run("a.csv", 6.0, samples=200), empty_run("b.csv", 7.0, load_case="laden", samples=200)]
    data = campaign(runs, vehicle=TOLERANT, load_cases=(EMPTY, LADEN))
    parameters, profiles, larger = campaign_parameters(data, None), {"bump": rigid_truck.bump()}, 0.01
    x = parameters.start.copy()
    n = np.exp(x[list(parameters.names).index("tire_exponent")])
    y = x.copy()
    # Of a tire these are stiffness and damping under the declared load; damping goes with the root of the deflection.
    share = {"stiffness": 1.0, "damping": 1.0, "tire_stiffness": 1.0 / n, "tire_damping": 1.0 - 0.5 / n}
    y += larger * np.array([share.get(p.quantity, 0.0) for p in parameters.parameters])
    model, other = (bump_model(data, parameters, profiles, tires=map_tires(parameters, v)) for v in (x, y))
    allowances = campaign_allowances(data, parameters, other.felt)
    names = [f.name for f in allowances.masses.factors]
    amounts = np.zeros(allowances.count)
    for k, name in enumerate(names):
        amounts[k] = larger if name == "axle_load_scale" else 0.0
    motion = RunMotion.steady(np.array([6.0, 7.0]), np.array([0.2, 0.2]))
    moved = allowances.moved(other, amounts)
    vehicle = allowances.masses.applied(amounts[: len(names)])
    unfollowed = allowances.departures.model(other.with_vehicle(*vehicle), amounts[len(names) :])
    trucks = ((model, x), (moved, y), (unfollowed, y))
    base, same, different = (np.concatenate(simulate_runs(truck, v, motion)) for truck, v in trucks)
    size = np.sqrt((base**2).mean(axis=(0, 1)))
    off, control = (np.sqrt(((s - base) ** 2).mean(axis=(0, 1))) / size for s in (same, different))
    # Footprints follow to first order.
    assert off.max() < 7e-4
    assert control.max() > 5e-3


def bending_truck():
    bent = replace(TOLERANT, bodies=(replace(TOLERANT.bodies[0], bending=FrameBending(8.0, 0.025)),))
    runs = [empty_run("empty.csv", 6.0), empty_run("laden.csv", 6.0, load_case="laden")]
    return campaign(runs, load_cases=(EMPTY, LADEN), vehicle=bent)


def test_where_the_mass_of_a_bending_frame_lies_is_unknown_in_every_load_case():
    masses = uncertain_masses(bending_truck())
    of_frames = [f.name for f, frame in zip(masses.factors, masses.undeclared, strict=True) if frame]
    body = VEHICLE.bodies[0].name
    quantities = ("frame_heave", "frame_pitch", "frame_modal_mass_factor")
    assert of_frames == [f"{q}[{body}, {case}]" for case in ("empty", "laden") for q in quantities]
    assert not uncertain_masses(campaign([empty_run("a.csv", 6.0)], vehicle=TOLERANT)).undeclared.any()


def test_amounts_of_a_frame_are_added_to_those_of_its_load_case():
    at_hand = bending_truck()
    laden = replace(at_hand.load_cases["laden"], frame_masses=(FrameMass(0.1, 0.0, -0.7),))
    masses = uncertain_masses(replace(at_hand, load_cases={**at_hand.load_cases, "laden": laden}))
    amounts = np.zeros(masses.sd.size)
    for number, factor in enumerate(masses.factors):
        if factor.load_case == "laden" and factor.quantity in ("frame_pitch", "frame_modal_mass_factor"):
            amounts[number] = 0.2
    _, cases = masses.applied(amounts)
    assert astuple(cases["laden"].frame_masses[0])[:3] == pytest.approx((0.1, 0.2, -0.5))
    assert astuple(cases["empty"].frame_masses[0])[:3] == (0.0, 0.0, 0.0)


def test_moved_masses_keep_the_kind_of_mass_along_a_frame():
    """Else the modal mass jumps while a fit moves the pitch inertia."""
    at_hand = bending_truck()
    masses = uncertain_masses(at_hand)
    inertia = next(i for i, f in enumerate(masses.factors) if f.quantity == INERTIA and "empty" in f.load_cases)

    def moved(amount: float) -> tuple[Vehicle, LoadCase]:
        amounts = np.zeros(masses.sd.size)
        amounts[inertia] = amount
        vehicle, cases = masses.applied(amounts)
        return vehicle, cases["empty"]

    def decided_anew(amount: float) -> tuple[Vehicle, LoadCase]:
        vehicle, case = moved(amount)
        return vehicle, replace(case, frame_masses=())

    def at_ends(amount: float) -> bool:
        vehicle, case = decided_anew(amount)
        return ends_carry_mass(vehicle, 0, case)

    # The declared mass has parts at the ends, that of a smaller inertia has not.
    low, high = -4.0 * masses.factors[inertia].sd, 0.0
    assert at_ends(high)
    assert not at_ends(low)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if at_ends(middle) else (middle, high)
    of = [frame_modes(*moved(amount))[0].modal_mass for amount in (low - 1e-6, high + 1e-6)]
    assert of[0] == pytest.approx(of[1], rel=3e-6)
    anew = [frame_modes(*decided_anew(amount))[0].modal_mass for amount in (low - 1e-6, high + 1e-6)]
    assert abs(anew[0] / anew[1] - 1.0) > 0.05


def test_a_step_takes_back_the_one_before_where_it_points_the_other_way():
    there = JointStep(np.array([1.0]), np.array([0.3, 0.0]), np.array([3.0, 0.0]))
    assert there.times(-0.8).takes_back(there)
    assert not there.takes_back(there)
    sideways = replace(there, over_sd=np.array([-1.0, 3.0]))
    assert not sideways.takes_back(there)
    assert there.times(-0.5).largest == 1.5


def test_the_clocks_of_a_run_that_go_back_and_forth_are_damped_alone():
    still = JointStep(np.zeros(1), np.zeros(2), np.zeros(2))
    before = joint_optimum._Step(still, np.array([[[0.2, -1.0]], [[0.0, 1.0]], [[0.0, 0.0]]]), 1.0)
    here = np.array([[[-0.2, 0.8]], [[0.1, 0.5]], [[0.3, 0.0]]])
    damped = joint_optimum._Step(still, here, 0.8).damped(before)
    np.testing.assert_array_equal(damped.clocks, here * np.array([0.5, 1.0, 1.0])[:, None, None])
    # What is left to go is not less for that.
    assert damped.largest == 0.8
    assert joint_optimum._Step(still, None, 0.8).damped(before).clocks is None


def test_a_step_after_which_residuals_are_larger_is_shortened(monkeypatch):
    """Weights that stay say nothing about residuals; the whole step leaves the range of the simulation."""
    still, options = joint_optimum._Step(JointStep(np.zeros(1), np.ones(1), np.ones(1)), None, 1.0), FitOptions()
    costs = {0.5: 2000.0, 0.25: 1010.0}

    def moved(campaign, optimum, step, *rest):
        if step.largest == 1.0:
            raise DataRejectedError("not finite")
        return SimpleNamespace(minimum=SimpleNamespace(cost=costs[step.largest]), misfit=1.0)

    def shares(weight_rounds: int) -> float | None:
        phase = options.phase(weight_rounds=weight_rounds)
        found = joint_optimum._improved(None, before, still, {}, options, phase, unwatched, worse=joint_optimum.WORSE)
        return None if found is None else found.minimum.cost

    monkeypatch.setattr(joint_optimum, "_moved", moved)
    before = SimpleNamespace(minimum=SimpleNamespace(cost=1000.0), misfit=1.0)
    assert shares(0) == 1010.0
    # Under new weights costs differ anyway, and their scales tell.
    assert shares(1) == 2000.0
    costs[0.25] = 1500.0
    assert shares(0) is None


@pytest.mark.parametrize(("found_in", "weighed"), [(None, [1, 1, 0, 0]), (0, [1, 1, 0, 0]), (2, [1, 1, 1, 0])])
def test_a_stop_that_is_found_late_asks_for_weights_once_more(monkeypatch, found_in: int | None, weighed: list[int]):
    rounds: list[int] = []

    def touched(campaign, optimum, phase, report):
        return SimpleNamespace(**vars(optimum)) if len(rounds) == found_in else optimum

    def improved(campaign, optimum, step, profiles, options, phase, report, **limit):
        rounds.append(phase.weight_rounds)
        return optimum

    lengths = iter([1.0, 1.0, 0.5, 0.01])
    step = JointStep(np.zeros(1), np.ones(1), np.ones(1))
    monkeypatch.setattr(joint_optimum, "with_touched_stops", touched)
    monkeypatch.setattr(joint_optimum, "_with_undeclared", lambda campaign, optimum, *rest: optimum)
    monkeypatch.setattr(joint_optimum, "_allowances", lambda *given: None)
    monkeypatch.setattr(joint_optimum, "_step", lambda *given: joint_optimum._Step(step, None, next(lengths)))
    monkeypatch.setattr(joint_optimum, "_improved", improved)
    start = SimpleNamespace(problem=SimpleNamespace(model=None))
    joint_optimum.joint_optimum(None, start, {}, FitOptions(weight_rounds=3), unwatched)
    assert rounds == weighed
