"""The study that leaves factors out: its changes act and end, and its table counts by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from studies.factors.leave_out import (
    FROM_COVARIANCE,
    MASSES,
    READINGS,
    REFITTED,
    without_correlation,
    without_departures,
)
from studies.factors.table import table
from sysid.campaign.vehicle_records import MassTolerances
from sysid.estimation.uncertainty import allowances
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.estimation.weights import reweighting


def test_changes_act_inside_and_end_with_their_block():
    before = allowances.departures, reweighting._inflation
    with without_departures():
        assert allowances.departures(None, ["empty"], [False]).directions == ()
    with without_correlation():
        found = reweighting._inflation(None, SimpleNamespace(residual=np.zeros((9, 2, 3))), None)
        np.testing.assert_array_equal(found, np.ones((2, 3)))
    assert (allowances.departures, reweighting._inflation) == before


def test_masses_and_readings_are_all_tolerances():
    names = set(MassTolerances.__dataclass_fields__)
    assert set(MASSES) | set(READINGS) == names


def test_model_form_and_laws_leave_the_covariance():
    data = DataInformation(
        np.eye(2) / 4.0, 0.5 * np.eye(2), np.zeros((2, 2)), np.zeros(0), 0, 4.0, np.array([[1.0, 0.0]])
    )
    whole = np.array([17.0, 16.0])
    np.testing.assert_allclose(np.diag(data.covariance()), whole)
    np.testing.assert_allclose(np.diag(FROM_COVARIANCE["undecided laws"](data).covariance()), [16.0, 16.0])
    np.testing.assert_allclose(np.diag(FROM_COVARIANCE["other model error"](data).covariance()), [2.0, 1.0])


def entry(kind: str, truth: float, low: float, middle: float, high: float) -> dict:
    return {"kind": kind, "truth": truth, "reported": [low, middle, high]}


def test_the_table_counts_by_hand():
    with_all = {"converged": True, "laws": [], "entries": [entry("stiffness", 1.0, 0.9, 1.0, 1.1)]}
    with_all["entries"].append(entry("damping", 2.0, 1.9, 2.02, 2.1))
    without = {"converged": False, "laws": ["friction"], "entries": [entry("stiffness", 1.0, 1.01, 1.02, 1.03)]}
    without["entries"].append(entry("damping", 2.0, 1.9, 2.02, 2.1))
    record = {"linear": True, "factors": {"nothing": with_all, "masses": without}}
    lines = table([record]).splitlines()
    assert lines[2] == "| nothing | 100 % | 100 % | 10.0, 5.0 % | 0.0, 1.0 % | 0 of 1 | 0 of 1 |"
    assert lines[3] == "| masses | 0 % | 100 % | 1.0, 5.0 % | 2.0, 1.0 % | 1 of 1 | 1 of 1 |"


@pytest.mark.parametrize("name", REFITTED)
def test_factors_have_names_that_the_report_uses_too(name):
    from sysid.estimation.uncertainty.interval_shares import SOURCES

    assert name in (*SOURCES, "nothing", "correlation of residuals")
