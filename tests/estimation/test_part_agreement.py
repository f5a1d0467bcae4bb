"""Parts of the data against each other, beside fits of them by NumPy's least squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from sysid.estimation.parameters.parameter_set import Parameter
from sysid.estimation.uncertainty.part_agreement import Block, part_agreement

PRIOR_SD, FURTHER_SD = np.array([0.3, 0.4, 0.5]), np.array([0.02, 0.1])
PARAMETERS = [
    Parameter("k_1", "stiffness", "N/m", 1.0, 1.0, 0.3, axle=0),
    Parameter("c_1", "damping", "N s/m", 1.0, 1.0, 0.4, axle=0),
    Parameter("kt_1", "tire_stiffness", "N/m", 1.0, 1.0, 0.5, axle=0),
]
KINDS = ("suspension_deflection", "axle_acceleration")
BLOCKS = [
    Block(case, speed_m_s=v, channel=c, sensor=KINDS[c]) for case in ("empty", "laden") for v in (2.0, 4.0, 6.0)
    for c in (0, 1)
]  # fmt: skip
ALL_SD = np.concatenate([PRIOR_SD, FURTHER_SD])
DIVISIONS = {
    "the load case 'empty'": lambda b: b.load_case == "empty",
    "the slower runs": lambda b: b.speed_m_s == 2.0,
    "the faster runs": lambda b: b.speed_m_s == 6.0,
    "the deflections": lambda b: b.channel == 0,
}


def least_squares(columns, data, chosen):
    """Unknowns that fit the chosen blocks and the priors."""
    rows = np.concatenate([np.diag(1.0 / ALL_SD), *(columns[i] for i in chosen)])
    return np.linalg.lstsq(rows, np.concatenate([np.zeros(5), *(data[i] for i in chosen)]), rcond=None)[0]


def agreement(columns, data):
    """What the module under test says, at the optimum of all data."""
    at = least_squares(columns, data, range(len(BLOCKS)))
    scores = np.array([c.T @ (c @ at - d) for c, d in zip(columns, data, strict=True)])
    information = np.array([c.T @ c for c in columns])
    return part_agreement(PARAMETERS, BLOCKS, scores, information, np.diag(PRIOR_SD**-2), FURTHER_SD)


@pytest.fixture(scope="module")
def columns():
    return np.random.default_rng(5).normal(size=(len(BLOCKS), 40, 5)) * [3.0, 2.0, 1.0, 4.0, 2.0]


def readings(columns, random, change=0.0, changed=lambda _: False):
    """Readings of one truck; in blocks `changed`, k is `change` higher."""
    truth = random.normal(size=5) * ALL_SD
    other = truth + np.array([change, 0, 0, 0, 0])
    return [
        c @ (other if changed(b) else truth) + random.normal(size=len(c))
        for b, c in zip(BLOCKS, columns, strict=True)
    ]  # fmt: skip


def test_differences_are_those_of_fits_to_each_part(columns):
    data = readings(columns, np.random.default_rng(1))
    found = agreement(columns, data).differences
    assert list(dict.fromkeys(d.part for d in found)) == list(DIVISIONS)
    for name, holds in DIVISIONS.items():
        inside = [i for i, b in enumerate(BLOCKS) if holds(b)]
        outside = [i for i in range(len(BLOCKS)) if i not in inside]
        expected = least_squares(columns, data, inside) - least_squares(columns, data, outside)
        given = [d.difference for d in found if d.part == name]
        assert given == pytest.approx(expected[:2], abs=1e-10)
    assert {d.parameter for d in found} == {"k_1", "c_1"}


def test_what_all_data_push_against_its_end_makes_no_difference_between_parts(columns):
    """The last unknown cannot be negative, and the readings of every part want it to be: bounded fits of SciPy."""
    truth = np.array([0.1, -0.2, 0.1, 0.01, -0.5])
    random = np.random.default_rng(4)
    data = [c @ truth + random.normal(size=len(c)) for c in columns]
    least = np.array([-np.inf] * 4 + [0.0])

    def bounded(chosen):
        rows = np.concatenate([np.diag(1.0 / ALL_SD), *(columns[i] for i in chosen)])
        wanted = np.concatenate([np.zeros(5), *(data[i] for i in chosen)])
        return lsq_linear(rows, wanted, (least, np.inf), tol=1e-14).x

    at = bounded(range(len(BLOCKS)))
    scores = np.array([c.T @ (c @ at - d) for c, d in zip(columns, data, strict=True)])
    known = scores, np.array([c.T @ c for c in columns]), np.diag(PRIOR_SD**-2)
    held, free = (
        part_agreement(PARAMETERS, BLOCKS, *known, sd).differences for sd in (FURTHER_SD * [1, 0], FURTHER_SD)
    )
    wrong = 0.0
    for name, holds in DIVISIONS.items():
        inside = [i for i, b in enumerate(BLOCKS) if holds(b)]
        outside = [i for i in range(len(BLOCKS)) if i not in inside]
        one, other = bounded(inside), bounded(outside)
        assert one[4] == pytest.approx(0.0, abs=1e-9)
        assert other[4] == pytest.approx(0.0, abs=1e-9)
        assert [d.difference for d in held if d.part == name] == pytest.approx((one - other)[:2], abs=1e-7)
        wrong = max([wrong, *np.abs([d.difference for d in free if d.part == name] - (one - other)[:2])])
    assert wrong > 0.01


def test_they_scatter_as_said_over_trucks_and_noise(columns):
    random = np.random.default_rng(2)
    drawn = [agreement(columns, readings(columns, random)).differences for _ in range(400)]
    over_sd = np.array([[d.difference / d.sd for d in ds] for ds in drawn])
    # 400 draws: the sd of a standard deviation is 3.5 %.
    assert over_sd.std(axis=0) == pytest.approx(np.ones(8), abs=0.14)
    seen = np.mean([any(d.seen for d in ds) for ds in drawn])
    assert seen < 0.03


def test_a_truck_that_changes_with_speed_is_seen(columns):
    random = np.random.default_rng(3)
    data = readings(columns, random, change=0.5, changed=lambda b: b.speed_m_s == 2.0)
    found = agreement(columns, data)
    seen = {(d.part, d.parameter) for d in found.differences if d.seen}
    assert ("the slower runs", "k_1") in seen
    assert all(d.forbids for d in found.differences if d.seen)
    (difference,) = (d.difference for d in found.differences if (d.part, d.parameter) == ("the slower runs", "k_1"))
    assert difference == pytest.approx(0.5, abs=0.15)
    assert np.abs(found.rows).max(axis=0)[0] >= 0.5 * difference
    assert not found.rows[:, 2].any()


def test_scatter_is_what_fits_to_parts_differ_by_beyond_chance(columns):
    """Every block has a k of its own: the variance that NumPy's fits show beyond the sd, and half of it in every k."""
    random = np.random.default_rng(6)
    scatter, beyond, least = [], [], []
    for _ in range(150):
        truth, shown = random.normal(size=5) * ALL_SD, []
        for c in columns:
            own = truth + np.array([0.2 * random.normal(), 0, 0, 0, 0])
            shown.append(c @ own + random.normal(size=len(c)))
        found = agreement(columns, shown)
        of_k = [d for d in found.differences if d.parameter == "k_1"]
        scatter.append(of_k[0].scatter)
        for d in of_k:
            inside = [i for i, b in enumerate(BLOCKS) if DIVISIONS[d.part](b)]
            outside = [i for i in range(len(BLOCKS)) if i not in inside]
            apart = least_squares(columns, shown, inside) - least_squares(columns, shown, outside)
            beyond.append(apart[0] ** 2 - d.sd**2)
        least.append(np.sum(found.rows[:, 0] ** 2) - 0.25 * scatter[-1] ** 2)
    assert np.mean(np.square(scatter)) == pytest.approx(np.mean(beyond), rel=0.05)
    assert np.mean(np.array(scatter) > 0.0) > 0.8
    assert min(least) > -1e-12


def test_scatter_of_a_right_model_is_called_none_but_in_one_of_a_hundred_campaigns(columns):
    random = np.random.default_rng(2)
    drawn = [agreement(columns, readings(columns, random)).differences for _ in range(400)]
    assert np.mean([any(d.scatter > 0.0 for d in ds) for ds in drawn]) < 0.03


def test_one_part_has_nothing_to_be_compared_with(columns):
    blocks = [Block("empty", speed_m_s=2.0, channel=0, sensor="axle_acceleration"), Block("empty")]
    found = part_agreement(PARAMETERS, blocks, np.zeros((2, 5)), np.zeros((2, 5, 5)), np.eye(3), FURTHER_SD)
    assert found.differences == ()
    assert found.rows.shape == (0, 3)


def test_what_is_held_takes_no_part(columns):
    data = readings(columns, np.random.default_rng(4))
    at = least_squares([c[:, :4] @ np.eye(4, 5) for c in columns], data, range(len(BLOCKS)))
    scores = np.array([c.T @ (c @ at - d) for c, d in zip(columns, data, strict=True)])
    information = np.array([c.T @ c for c in columns])
    held, left = (
        part_agreement(PARAMETERS, BLOCKS, s, h, np.diag(PRIOR_SD**-2), sd).differences
        for s, h, sd in (
            (scores, information, np.array([0.02, 0.0])),
            (scores[:, :4], information[:, :4, :4], np.array([0.02])),
        )
    )
    assert [(d.difference, d.sd) for d in held] == [pytest.approx((d.difference, d.sd), rel=1e-9) for d in left]
