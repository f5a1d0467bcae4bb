"""Bushings are named with the stiffness of an axle's own part and the common one, where they are clear and soft."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit.found_bushings import found_bushings
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import BUSHING, FRICTION, Departure, Departures
from sysid.estimation.uncertainty.mass_response import MassResponse

KINDS = (Departure(FRICTION, 0), Departure(BUSHING, 0), Departure(BUSHING, 1), Departure(BUSHING, None))


def said(own: tuple[float, float], common: float, sd: float) -> tuple[str, ...]:
    allowances = Allowances(SimpleNamespace(factors=("one mass",)), Departures(None, KINDS))
    amounts = np.array([0.01, 0.02, *own, common])
    factor = np.zeros((5, 1))
    factor[4] = sd
    return found_bushings(allowances, MassResponse(np.zeros(2), np.zeros((5, 2)), factor, amounts), np.eye(2))


def test_the_stiffness_is_the_inverse_of_both_compliances_together():
    (sentence,) = said((0.05, 0.0), 0.2, 0.01)
    assert "4 ± 0.2 MN/m (axle 1) and 5 ± 0.2 MN/m (axle 2)" in sentence


@pytest.mark.parametrize(("own", "common", "sd"), [((0.0, 0.0), 0.2, 0.1), ((0.01, 0.0), 0.03, 1e-3)])
def test_unclear_or_stiff_bushings_are_not_named(own, common, sd):
    assert said(own, common, sd) == ()
