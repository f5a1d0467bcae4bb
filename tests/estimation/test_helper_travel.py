"""Helper leaves are tried where the loads of the campaign show them, not beyond all of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit.helper_travel import compressions_by_load, tried_helper_travel
from sysid.estimation.fit.law_screen import LawCandidate, travel_penalty
from sysid.estimation.fit.least_squares import _start_from
from sysid.estimation.parameters.parameter_set import Parameter
from sysid.estimation.parameters.suspension_curves import helper_ramps
from sysid.estimation.parameters.suspension_elements import HELPER_SD, HELPER_TRAVEL_M, quantities

#: Loads [N] of two springs in an empty and a laden run, stiffness [N/m]; the first spring carries no more when laden.
EMPTY_N, LADEN_N, STIFFNESS = np.array([4.0e4, 2.0e4]), np.array([4.0e4, 7.4e4]), np.array([4.0e5, 1.8e6])


def optimum() -> SimpleNamespace:
    carried = np.stack([EMPTY_N, LADEN_N])[..., None]
    laws = SimpleNamespace(
        carried_load=carried, load_growth=carried / EMPTY_N[:, None], stiffness=np.array([[0, 1], [0, 1]])
    )
    names = ("k_1", "k_2")
    model = SimpleNamespace(arrays=[SimpleNamespace(laws=laws)], parameters=SimpleNamespace(names=names))
    return SimpleNamespace(problem=SimpleNamespace(model=model), vector=np.log([*STIFFNESS, 6.0]))


def test_compressions_by_hand():
    assert compressions_by_load(optimum()) == pytest.approx({1: 5.4e4 / 1.8e6})


@pytest.mark.parametrize(("compression_m", "travel_m"), [(None, 0.03), (0.08, 0.03), (0.02, 0.01)])
def test_half_way_to_the_heaviest_load_or_as_usual(compression_m, travel_m):
    assert tried_helper_travel(0.03, compression_m) == pytest.approx(travel_m)


def test_helpers_that_are_tried_act_at_rest_under_load_and_those_at_the_usual_travel_do_not():
    """A spring of 1.8 MN/m gives way by 30 mm under 54 kN: helpers from 30 mm on would act in neither load case."""
    found = compressions_by_load(optimum())[1]
    further = np.array([0.0, LADEN_N[1] - EMPTY_N[1]])[:, None, None]

    def slope(travel_m: float) -> np.ndarray:
        ones = np.ones((2, 1, 1))
        return helper_ramps(8e4 * ones, travel_m * ones, STIFFNESS[1] * ones, further)[0][:, 0, 0]

    np.testing.assert_allclose(slope(HELPER_TRAVEL_M), 1.8e6)
    np.testing.assert_allclose(slope(tried_helper_travel(HELPER_TRAVEL_M, found)), [1.8e6, 1.88e6])


def test_new_helpers_begin_there_and_others_where_they_were():
    new = [Parameter(f"helper_travel_{i + 1}", "helper_travel", "m", 0.03, 0.03, 0.8, axle=i) for i in (0, 1)]
    known = [Parameter("k_2", "stiffness", "N/m", 1e6, 1e6, 0.8, axle=1)]
    near = optimum()
    begun = _start_from(SimpleNamespace(parameters=(*known, *new)), near)
    np.testing.assert_allclose(np.exp(begun), [1.8e6, 0.03, 0.015])
    near.problem.model.parameters.names = ("k_1", "k_2", "helper_travel_2")
    again = _start_from(SimpleNamespace(parameters=(*known, *new)), near)
    np.testing.assert_allclose(np.exp(again), [1.8e6, 0.03, 6.0])


def test_the_prior_of_the_travel_takes_its_part_of_the_gain():
    (helper,) = (q for q in quantities(frozenset({"helper_spring"})) if q.decides)
    vehicle = SimpleNamespace(axles=(None, SimpleNamespace(suspension="leaf")))
    candidate = LawCandidate("helper_spring", helper, (1,))
    expected = (np.log(0.5) / HELPER_SD) ** 2
    assert travel_penalty(vehicle, {("helper_travel", 1): 0.03}, candidate) == pytest.approx(expected)
    assert travel_penalty(vehicle, {}, candidate) == 0.0
