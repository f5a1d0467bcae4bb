"""What data determine, on linear problems whose null spaces and covariances are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_fit import synthetic_fit

from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.estimation.uncertainty.identifiability import Identifiability, assess, correlated_pairs

NAMES = ("k_1", "k_2", "k_3", "c_1")
VALUES = np.array([4e5, 4e5, 4e5, 1e4])
PRIOR_SD = np.array([0.5, 0.5, 0.5, 0.8])


def estimate(name: str, value: float, prior_sd: float, sd: float) -> ParameterEstimate:
    quantity, unit = ("stiffness", "N/m") if name[0] == "k" else ("damping", "N s/m")
    rest = (value, value, prior_sd, True)
    return ParameterEstimate(name, quantity, unit, 0, None, None, "linear", "log", value, sd * value, *rest)


def judged(jacobian: np.ndarray, values: np.ndarray = VALUES) -> Identifiability:
    """A linear problem with rows `jacobian` (m, 4) of unit noise in the log parameters."""
    information = DataInformation(jacobian.T @ jacobian, np.eye(4), np.diag(PRIOR_SD**-2.0), np.zeros(0), 0)
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.diag(PRIOR_SD**-2.0))
    sd = np.sqrt(np.diag(covariance))
    estimates = [estimate(*row) for row in zip(NAMES, values, PRIOR_SD, sd, strict=True)]
    return assess(estimates, covariance, information)


def test_a_jacobian_of_full_rank_leaves_nothing_open():
    found = judged(np.diag([50.0, 40.0, 30.0, 20.0]))
    # Columns in units of prior sd: 50 * 0.5 and so on.
    np.testing.assert_allclose(found.singular_values, [25.0, 20.0, 16.0, 15.0])
    assert found.determined == 4
    assert found.groups == ()
    assert found.pairs == ()
    assert found.statements == ()


def test_shrinkage_is_that_of_a_normal_prior_and_one_reading():
    found = judged(np.diag([50.0, 40.0, 30.0, 20.0]))
    np.testing.assert_allclose(found.shrinkage, 1.0 / np.sqrt(1.0 + np.array([25.0, 20.0, 15.0, 16.0]) ** 2))


def test_a_parameter_without_data_is_named():
    (group,) = judged(np.diag([50.0, 40.0, 30.0, 0.0])).groups
    assert (group.names, group.known, group.kind) == (("c_1",), 0, "none")
    found = judged(np.diag([50.0, 40.0, 30.0, 0.0]))
    assert found.determined == 3
    assert found.singular_values[-1] == 0.0
    assert found.statements == ("The data do not determine c_1: nothing is known there beyond the prior.",)


def test_two_springs_of_which_only_the_sum_acts():
    """Equal springs: the reading is k_1 + k_2, so 100 (dlog k_1 + dlog k_2) / 2 in units of its noise."""
    rows = np.array([[50.0, 50.0, 0.0, 0.0], [0.0, 0.0, 30.0, 0.0], [0.0, 0.0, 0.0, 20.0]])
    found = judged(rows)
    (group,) = found.groups
    assert (group.names, group.known, group.kind) == (("k_1", "k_2"), 1, "sum")
    # The mean of two logs with prior variance 0.125 and one reading of precision 100^2.
    assert group.relative_sd == pytest.approx((100.0**2 + 1 / 0.125) ** -0.5)
    assert found.determined == 3
    assert "k_1 and k_2 are only known as a sum" in found.statements[0]
    assert "1 %" in found.statements[0]
    # Each keeps the prior of the difference: half of the variance 0.5 of dlog k_1 - dlog k_2, quartered.
    assert found.shrinkage[0] == pytest.approx(np.sqrt(0.5), abs=1e-3)


def test_unequal_springs_in_a_sum():
    """k_1 + k_2 with k_2 three times k_1: slopes 1 to 3 of the logarithms."""
    rows = np.array([[25.0, 75.0, 0.0, 0.0], [0.0, 0.0, 30.0, 0.0], [0.0, 0.0, 0.0, 20.0]])
    values = np.array([4e5, 12e5, 4e5, 1e4])
    (group,) = judged(rows, values).groups
    assert group.kind == "sum"
    (other,) = judged(rows).groups
    assert other.kind == "combination"


def test_two_springs_of_which_only_the_ratio_acts():
    rows = np.array([[50.0, -50.0, 0.0, 0.0], [0.0, 0.0, 30.0, 0.0], [0.0, 0.0, 0.0, 20.0]])
    (group,) = judged(rows).groups
    assert (group.names, group.kind) == (("k_1", "k_2"), "ratio")
    assert group.relative_sd == pytest.approx((50.0**2 + 2.0) ** -0.5)


def test_three_springs_of_which_only_the_sum_acts_are_one_group():
    """No pair of them is strongly correlated (-1/2 each), yet none is known."""
    rows = np.array([[50.0, 50.0, 50.0, 0.0], [0.0, 0.0, 0.0, 20.0]])
    found = judged(rows)
    (group,) = found.groups
    assert (group.names, group.known, group.kind) == (("k_1", "k_2", "k_3"), 1, "sum")
    assert found.pairs == ()


def test_pairs_that_are_known_but_hard_to_tell_apart():
    """The sum to 0.1 %, the difference to 2 %: correlation (a - b) / (a + b) of the variances."""
    rows = np.array([[500.0, 500.0, 0.0, 0.0], [25.0, -25.0, 0.0, 0.0], [0, 0, 30.0, 0], [0, 0, 0, 20.0]])
    found = judged(rows)
    assert found.groups == ()
    (pair,) = found.pairs
    near, far = 1 / (2 * 500.0**2 + 4.0), 1 / (2 * 25.0**2 + 4.0)
    assert pair.correlation == pytest.approx((near - far) / (near + far))
    assert "more of one and less of the other" in found.statements[0]


def test_pairs_come_strongest_first():
    covariance = np.array([[1.0, 0.95, 0.0], [0.95, 1.0, -0.1], [0.0, -0.1, 1.0]])
    assert [(p.first, p.second) for p in correlated_pairs(("a", "b", "c"), covariance)] == [("a", "b")]
    assert len(correlated_pairs(("a", "b", "c"), covariance, 0.05)) == 2


def dense(seed: int = 3) -> tuple[np.ndarray, np.ndarray, DataInformation]:
    """Jacobian (80, 3 + 2) in parameters and masses, a flattening, and what is made of them."""
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(80, 5)) * [3.0, 1.0, 2.0, 20.0, 9.0]
    return jacobian, np.diag([0.4, 0.6, 0.8]), DataInformation(
        jacobian.T @ jacobian, np.diag([0.4, 0.6, 0.8]), np.diag([0.5, 0.0, 2.0]), np.array([0.03, 0.05]), 2
    )  # fmt: skip


def test_a_copy_of_all_runs_halves_the_variance_of_noise():
    jacobian, _, information = dense()
    exact = replace(information, sd=np.zeros(0), masses=0, prior=np.zeros((3, 3)), matrix=information.matrix[:3, :3])
    np.testing.assert_allclose(exact.covariance(exact.matrix), 0.5 * exact.covariance(), rtol=1e-10)
    once = np.linalg.inv(exact.flattening.T @ jacobian[:, :3].T @ jacobian[:, :3] @ exact.flattening)
    np.testing.assert_allclose(exact.covariance(), once, rtol=1e-10)


def test_masses_that_the_data_see_are_learnt_from_more_data_and_others_stay_open():
    """Without priors, against the inverse of the joint information; a mass that moves all alike stays as it was."""
    jacobian, flattening, information = dense()
    bare = replace(information, prior=np.zeros((3, 3)), flattening=np.eye(3))
    for copies in (1, 2):
        joint = copies * jacobian.T @ jacobian
        joint[3:, 3:] += np.diag(information.sd**-2.0)
        more = (copies - 1) * bare.matrix
        np.testing.assert_allclose(bare.covariance(more), np.linalg.inv(joint)[:3, :3], rtol=1e-9)
    # Model error widens what more data say as it widens what there is.
    wide = replace(bare, matrix=bare.matrix / 4.0, factor=4.0)
    np.testing.assert_allclose(
        wide.precision(bare.matrix), replace(bare, matrix=bare.matrix / 2.0).precision(), rtol=1e-12
    )
    # Flattening is that of the marginal information.
    flat = replace(bare, flattening=flattening)
    np.testing.assert_allclose(flat.precision(), flattening @ bare.precision() @ flattening, rtol=1e-12)
    # A mass whose column is a mix of those of the parameters: its tolerance is carried over whatever the data.
    alike = jacobian.copy()
    mix = np.array([[0.4, -0.2], [0.1, 0.3], [-0.3, 0.2]])
    alike[:, 3:] = alike[:, :3] @ mix
    carried = (mix * information.sd**2) @ mix.T
    noise = np.linalg.inv(alike[:, :3].T @ alike[:, :3])
    same = replace(bare, matrix=alike.T @ alike)
    np.testing.assert_allclose(same.covariance(), noise + carried, rtol=1e-7)
    np.testing.assert_allclose(same.covariance(same.matrix), 0.5 * noise + carried, rtol=1e-7)


def test_the_fit_s_covariance_comes_out_again():
    fit = synthetic_fit().result
    found = fit.identifiability
    np.testing.assert_allclose(found.information.covariance(), fit.covariance, rtol=1e-6)
    assert found.names == fit.names
    assert found.groups == ()
    assert found.determined == len(found.names)
    assert list(found.summary()["name"]) == list(fit.names)
