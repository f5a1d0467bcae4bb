"""Values that no truck has: friction of many loads, slip over metres; tires other than declared are another matter."""

from __future__ import annotations

import pytest

from sysid.estimation.fit.implausible_values import implausible_values
from sysid.estimation.parameters.estimate import ParameterEstimate

CARRIED = {0: 4e4}


def of(quantity: str, value: float, median: float, sd: float, axle: int | None = 0) -> ParameterEstimate:
    return ParameterEstimate(
        quantity, quantity, "unit", axle, None, None, "", "log", value, 0.1, median, median, sd, True
    )


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (of("friction", 2.8e6, 2e3, 1.0), "70 times the load carried"),
        (of("slip_length", 7.7, 1e-3, 0.7, None), "two stages or helper leaves"),
        (of("damper_asymmetry", 40.0, 1.5, 0.7), "4.7 standard deviations"),
        (of("damper_asymmetry", 0.05, 1.5, 0.7), "4.9 standard deviations"),
        (of("bushing_stiffness", 1e5, 6e6, 0.7), "5.8 standard deviations"),
    ],
)
def test_a_value_that_no_truck_has_is_named(parameter, words):
    found = implausible_values([parameter], CARRIED)
    assert not found.contradict
    assert words in found.impossible[0]


@pytest.mark.parametrize(
    "parameter",
    [
        # A leaf pack of 8 % and 6 mm, and elements that have vanished.
        of("friction", 3.2e3, 2e3, 1.0),
        of("slip_length", 6e-3, 1e-3, 0.7, None),
        of("friction", 1e-4, 2e3, 1.0),
        of("damper_rounding", 1e-6, 0.5, 1.0),
        of("damper_knee", 1e4, 0.6, 0.8),
        of("bushing_stiffness", 1e12, 6e6, 0.7),
        of("jounce_travel", 0.04, 0.075, 0.12),
        of("stiffness", 4e5, 1e6, 0.8),
        of("tire_stiffness", 2.2e6, 1.65e6, 0.1),
    ],
)
def test_usual_values_and_elements_without_effect_are_not(parameter):
    found = implausible_values([parameter], CARRIED)
    assert (found.impossible, found.contradict) == ((), ())


def test_a_tire_far_from_the_declared_one_contradicts_and_is_possible():
    found = implausible_values([of("tire_stiffness", 2.6e6, 1.65e6, 0.1)], CARRIED)
    assert not found.impossible
    assert "4.5 standard deviations of its prior" in found.contradict[0]
