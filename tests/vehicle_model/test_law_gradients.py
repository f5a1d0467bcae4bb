"""Derivatives through every suspension law: forward = reverse = central differences, in runs with lift-off.

Reverse mode takes a minute to compile for each law set: `make test` has it for the richest, `make test-long` for all.

Speed and step put every wheel exactly on the stations of the road table; the record begins at rest, where friction and
asymmetric dampers have their corner; a table ends inside the travel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import SPEED_M_S
from rigid_truck import DAMPING, STIFFNESS
from simulated_truck import per_axle, truck_model
from test_suspension_laws import LAWS, LINEAR

from sysid.vehicle_model.suspension import Ramps

TABLE = Ramps(
    at=jnp.stack([per_axle(np.full(3, x)) for x in (0.004, -0.003)]),
    slope=jnp.stack([per_axle(0.4 * STIFFNESS), per_axle(-0.3 * STIFFNESS)]),
    side=jnp.stack([per_axle(np.ones(3)), per_axle(-np.ones(3))]),
)
VALVE = Ramps(
    at=jnp.stack([per_axle(np.full(3, v)) for v in (0.1, -0.2)]),
    slope=jnp.stack([per_axle(-0.5 * DAMPING), per_axle(0.4 * DAMPING)]),
    side=jnp.stack([per_axle(np.ones(3)), per_axle(-np.ones(3))]),
)
EVERYTHING = LINEAR
for _, one in LAWS.values():
    EVERYTHING = EVERYTHING._replace(
        **{f: v for f, v in one._asdict().items() if v is not None and f not in ("stiffness", "damping")}
    )
RICHEST = "friction, gas spring, saturating and asymmetric damper, stops"
CASES = {
    "linear": LINEAR,
    RICHEST: EVERYTHING,
    "tables": LINEAR._replace(ramps=TABLE, rate_ramps=VALVE),
}


@pytest.fixture(scope="module")
def model():
    return truck_model(0.0025, duration_s=0.7)


def scaled(law, logs: jax.Array):
    """The law with its k-th array multiplied by exp(logs[k])."""
    leaves, tree = jax.tree.flatten(law)
    return jax.tree.unflatten(tree, [leaf * jnp.exp(logs[k]) for k, leaf in enumerate(leaves)])


def outcome_of(model, law) -> tuple[Callable[[jax.Array], jax.Array], np.ndarray]:
    """One number of a run, of logarithms of the law's arrays and the speed, and which of them are quantities."""
    count = len(jax.tree.leaves(law))
    weight = np.random.default_rng(1).normal(size=(2, 3, 1))

    def outcome(logs: jax.Array) -> jax.Array:
        found = model(scaled(law, logs[:-1]), SPEED_M_S * jnp.exp(logs[-1]))
        force = (found.tire_force * weight).sum() / 1e6
        travel = (found.deflection * weight).sum() * 10.0
        return force + travel + (found.axle_acceleration * weight).sum() / 1e3

    # The side of a ramp is a sign, not a quantity: its direction is left out.
    sides = [leaf is part.side for part in (law.ramps, law.rate_ramps) if part is not None for leaf in part]
    free = np.ones(count + 1)
    if sides:
        free[count - len(sides) : count] = ~np.array(sides)
    return outcome, free


@pytest.fixture(scope="module")
def forward(model) -> Callable[[str], np.ndarray]:
    """Derivatives of the outcome of a case by forward mode."""

    @cache
    def of(name: str) -> np.ndarray:
        outcome, free = outcome_of(model, CASES[name])
        return np.asarray(jax.jit(jax.jacfwd(outcome))(jnp.zeros(free.size))) * free

    return of


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long) if n == RICHEST else n for n in CASES])
def test_forward_mode_and_differences_agree(model, forward, name: str):
    outcome, free = outcome_of(model, CASES[name])
    slope, run, at = forward(name), jax.jit(outcome), jnp.zeros(free.size)
    assert np.isfinite(slope).all()
    rng = np.random.default_rng(2)
    for _ in range(3):
        direction = rng.normal(size=free.size) * free
        step = 1e-6
        difference = (run(at + step * direction) - run(at - step * direction)) / (2.0 * step)
        assert float(slope @ direction) == pytest.approx(float(difference), rel=1e-6, abs=1e-6 * np.abs(slope).max())


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_forward_and_reverse_mode_agree(model, forward, name: str):
    outcome, free = outcome_of(model, CASES[name])
    reverse = np.asarray(jax.jit(jax.grad(outcome))(jnp.zeros(free.size))) * free
    assert np.isfinite(reverse).all()
    np.testing.assert_allclose(forward(name), reverse, rtol=0, atol=1e-10 * np.abs(reverse).max())
