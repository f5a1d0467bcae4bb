"""Departures are named with the value of an axle's own part and the common one, where they are clear and large."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit.found_departures import found_departures
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import BUMP, BUSHING, FRICTION, TRAILING, Departure, Departures
from sysid.estimation.uncertainty.mass_response import MassResponse


def said(kind: str, own: tuple[float, float], common: float, sd: float) -> tuple[str, ...]:
    kinds = (Departure(FRICTION, 0), Departure(kind, 0), Departure(kind, 1), Departure(kind, None))
    allowances = Allowances(SimpleNamespace(factors=("one mass",)), Departures(None, kinds))
    amounts = np.array([0.01, 0.02, *own, common])
    factor = np.zeros((5, 1))
    factor[4] = sd
    found = found_departures(allowances, MassResponse(np.zeros(2), np.zeros((5, 2)), factor, amounts), np.eye(2))
    assert all(c.kind == kind and c.modelled for c in found)
    return tuple(c.sentence for c in found)


def test_the_stiffness_is_the_inverse_of_both_compliances_together():
    (sentence,) = said(BUSHING, (0.05, 0.0), 0.2, 0.01)
    assert "4 ± 0.2 MN/m (axle 1) and 5 ± 0.2 MN/m (axle 2)" in sentence


def test_a_bump_is_lower_by_what_all_axles_and_each_of_them_say():
    (sentence,) = said(BUMP, (-0.02, 0.15), -0.06, 0.01)
    assert "8 ± 1 % lower (axle 1) and 9 ± 1 % higher (axle 2)" in sentence


def test_wheels_go_aft_or_forward_by_what_all_axles_and_each_of_them_say():
    (sentence,) = said(TRAILING, (0.02, -0.15), 0.06, 0.01)
    assert "8 ± 1 % aft (axle 1) and 9 ± 1 % forward (axle 2)" in sentence


@pytest.mark.parametrize(
    ("kind", "own", "common", "sd"),
    [
        (BUSHING, (0.0, 0.0), 0.2, 0.1),
        (BUSHING, (0.01, 0.0), 0.03, 1e-3),
        (BUMP, (0.0, 0.0), -0.08, 0.03),
        (BUMP, (0.001, 0.0), 0.018, 1e-3),
        (TRAILING, (0.0, 0.0), 0.08, 0.03),
        (TRAILING, (0.001, 0.0), 0.018, 1e-3),
    ],
)
def test_unclear_or_small_departures_are_not_named(kind, own, common, sd):
    assert said(kind, own, common, sd) == ()
