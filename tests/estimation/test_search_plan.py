"""Phases of a search: no plan is finer than the settings ask, and a search goes through the phases of its plan."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit import least_squares
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.search_plan import (
    SearchPlan,
    base,
    before_joint,
    exact,
    first_sight,
    rough_trial,
    trial,
)
from sysid.progress import unwatched

OPTIONS = FitOptions()
PLANS = [exact, before_joint, first_sight, base, trial, rough_trial]


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("near", [False, True])
@pytest.mark.parametrize("options", [OPTIONS, FitOptions(weight_rounds=0, max_iterations=3, tolerance=1e-2)])
def test_no_phase_is_finer_than_the_settings(plan, near, options):
    phases = plan(options, near)
    for phase in (phases.first, phases.end):
        assert phase.weight_rounds <= options.weight_rounds
        assert phase.max_iterations <= options.max_iterations
        assert phase.tolerance >= options.tolerance
    # What finds the tires of the maps is no finer than the end.
    assert phases.first.tolerance >= phases.end.tolerance
    assert phases.first.max_iterations <= phases.end.max_iterations


def test_only_the_fit_itself_has_the_steps_of_the_settings_and_all_rounds():
    for plan in PLANS:
        end = plan(OPTIONS, False).end
        assert (end == OPTIONS.phase()) is (plan is exact)
        assert end.larger_steps is (plan is not exact)


@pytest.mark.parametrize("plan", PLANS)
def test_maps_that_follow_no_tires_are_not_made_again(plan):
    phases = plan(replace(OPTIONS, contact="point"), False)
    assert (phases.map_rounds, phases.last) == (0, None)
    # Trials keep the maps of the optimum that they are compared with.
    assert (plan(OPTIONS, False).map_rounds > 0) is (plan not in (trial, rough_trial))


class Tires:
    """Tires of maps: alike once the maps have been made so often."""

    def __init__(self, made: int, alike_after: int):
        self.made, self._alike_after = made, alike_after

    def like(self, other: object) -> bool:
        return self.made >= self._alike_after


@pytest.mark.parametrize(("alike_after", "maps"), [(1, 1), (3, 3), (99, 4)])
def test_a_search_goes_through_its_phases_until_the_maps_are_those_of_its_tires(alike_after, maps, monkeypatch):
    first, last = OPTIONS.phase(tolerance=1e-5, larger_steps=True), OPTIONS.phase()
    gone: list[object] = []

    def searched(campaign, model, motion, instrument, start, phase, report, **given):
        gone.append(phase)
        problem = SimpleNamespace(model=model, count=1, weights=None, unpack=lambda vector: (vector, motion))
        return SimpleNamespace(
            problem=problem, vector=np.zeros(1), instrument=(), minimum=SimpleNamespace(damping=None)
        )

    def model_with(tires):
        return SimpleNamespace(tires=tires, parameters=None)

    monkeypatch.setattr(least_squares, "bump_model", lambda *given, tires, **rest: model_with(tires))
    monkeypatch.setattr(least_squares, "map_tires", lambda *given: Tires(len(gone), alike_after))
    monkeypatch.setattr(least_squares, "with_run_paths", lambda tires, *given: tires)
    monkeypatch.setattr(least_squares, "_find_motion", lambda *given: (None, ()))
    monkeypatch.setattr(least_squares, "check_load_cases", lambda *given: None)
    monkeypatch.setattr(least_squares, "optimise_from", searched)
    monkeypatch.setattr(least_squares, "continued", lambda optimum, before: optimum)
    parameters = SimpleNamespace(start=np.zeros(1), names=("k_1",))
    least_squares.optimise(
        None, parameters, {}, OPTIONS, unwatched, plan=lambda options, near: SearchPlan(first, 4, last)
    )
    assert gone == [first, *[first] * maps, last]
    gone.clear()
    least_squares.optimise(None, parameters, {}, OPTIONS, unwatched, plan=lambda options, near: SearchPlan(first))
    assert gone == [first]
