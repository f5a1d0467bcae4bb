"""Dry friction and two body modes told apart: closed forms of both, on a vehicle with neighbouring axles."""

from __future__ import annotations

import numpy as np
import pytest
from decay_oracles import damped_cosine, nonlinear_decay

from sysid.sdof.damping_choice import more_than_viscous
from sysid.sdof.damping_law import fit_damping_law
from sysid.sdof.decay import prepare_record
from sysid.sdof.free_decay import fit_free_decay

TIME = np.arange(0.0, 4.6, 0.005)


def chosen(value, seed, neighbours):
    """Terms of the law that a record with 0.25 mm of noise is said to show, None where it is not."""
    noisy = value + 2.5e-4 * np.random.default_rng(seed).standard_normal(TIME.size)
    record = prepare_record(TIME, noisy, skip_first_turn=True, frequency_range_hz=(0.6, 6.0))
    law = more_than_viscous(fit_damping_law(record), record, fit_free_decay(record), neighbours=neighbours)
    return law.terms if law is not None else None


def two_modes(frequency_hz, ratio, share):
    """Bounce and pitch: two viscous modes let go together, the second with a share of the amplitude of the first."""
    first, second = ((1.0 / f, 2.0 * np.pi * z) for f, z in zip(frequency_hz, ratio, strict=True))
    return damped_cosine(TIME, *first) + damped_cosine(TIME, *second, amplitude=0.04 * share)


@pytest.mark.parametrize(
    ("frequency_hz", "ratio", "share"),
    [
        ((2.15, 3.30), (0.20, 0.07), -0.54),
        ((1.41, 2.03), (0.19, 0.18), -0.75),
        ((2.16, 2.65), (0.17, 0.12), -0.38),
        ((1.87, 2.62), (0.07, 0.07), 0.78),
        ((1.68, 3.16), (0.14, 0.11), -0.40),
    ],
)
def test_a_second_body_mode_is_no_friction(frequency_hz, ratio, share):
    value = two_modes(frequency_hz, ratio, share)
    assert [chosen(value, seed, neighbours=True) for seed in range(2)] == [None, None]
    # A single axle has no second body mode: there the same record speaks for friction or quadratic damping.
    assert any(chosen(value, seed, neighbours=False) is not None for seed in range(2))


@pytest.mark.parametrize("friction", [0.001, 0.003])
@pytest.mark.parametrize("linear", [0.0, 0.3])
def test_friction_is_still_found_beside_neighbours(friction, linear):
    value = nonlinear_decay(TIME, 2.0 * np.pi / 0.6, 0.04, friction=friction, linear=linear)
    assert "friction" in (chosen(value, 0, neighbours=True) or ())
