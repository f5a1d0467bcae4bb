"""Runs of the truck by diffrax: Tsit5 with adaptive steps, each run with each parameter set alone, under `vmap`."""

from __future__ import annotations

from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers.constants import Acquisition, RunConstants
from benchmarks.peers.steppers import ABSOLUTE, MAX_STEP_S
from sysid.vehicle_model.contact import RoadInput, TireLaw, contact_force

Batch = Callable[[float], np.ndarray]


def _road(c: RunConstants, s: jax.Array) -> RoadInput:
    """Road and footprint map (na,) at positions s (na,), as :func:`contact_force` takes it."""
    scaled = jnp.clip((s - c.first_station) / c.step, 2.0, c.table.shape[2] - 4.0)
    cell = jnp.floor(scaled).astype(jnp.int32)
    t = scaled - cell
    weights = c.table[:, jnp.arange(s.size)[:, None], cell[:, None] + jnp.arange(-2, 4)]
    terms = jnp.einsum("pk,rik->pri", c.polynomial, weights)
    orders = []
    for _ in range(4):
        value = terms[-1]
        for term in terms[-2::-1]:
            value = value * t + term
        orders.append(value / c.step ** len(orders))
        terms = terms[1:] * jnp.arange(1, terms.shape[0])[:, None, None]
    rise, slope, second, third = (o[0] for o in orders)
    none = jnp.zeros_like(rise)
    stretch, drag = (tuple(o[rows] for o in orders) for rows in (slice(1, 5), slice(5, 8)))
    # One run with one set: (rows, R, na, S) without R and S.
    stretch, drag = (tuple(o[:, None, :, None] for o in part) for part in (stretch, drag))
    lift = (o[None, :, None] for o in (rise, slope, second, third, none))
    return RoadInput(*lift, stretch, drag)


def _rates(t: jax.Array, y: jax.Array, c: RunConstants) -> tuple[jax.Array, jax.Array]:
    """y' and the suspension extensions."""
    nb, na = c.position.shape[1], c.rest.shape[0]
    body, axle, body_rate, axle_rate = jnp.split(y, [nb, nb + na, 2 * nb + na])
    shift, drift = c.position @ body, c.rate @ body_rate

    def alone(x: jax.Array) -> jax.Array:
        return x[None, :, None]

    law = TireLaw(*(alone(x) for x in (c.rest, c.reference, c.reference_load, c.exponent, c.tire_damping)))
    road = _road(c, c.speed * (t - c.start) - c.axle_x)
    advance, speed = shift[na : 2 * na], drift[na : 2 * na] + c.speed
    unclipped, drag = contact_force(law, road, alone(advance), alone(speed), alone(axle), alone(axle_rate))
    vertical = jnp.maximum(unclipped[0, :, 0], 0.0)
    extension, rate = shift[:na] - axle, drift[:na] - axle_rate
    pull = c.stiffness * extension + c.damping * rate
    forces = jnp.concatenate([pull, drag[0, :, 0] * vertical])
    body_acceleration = c.acceleration @ forces + shift[2 * na :] + drift[2 * na :]
    axle_acceleration = c.inverse_unsprung * (vertical - c.static_load + pull)
    return jnp.concatenate([body_rate, axle_rate, body_acceleration, axle_acceleration]), extension


def diffrax_batch(runs: list[RunConstants], acquisition: Acquisition, sets: int) -> Batch:
    """Function of the tolerance that gives filtered signals (T, sets, R, C); the sets differ by 5 % in stiffness."""
    times, layout = acquisition.times, acquisition.layout
    stacked = RunConstants(*(jnp.stack([jnp.asarray(x) for x in each]) for each in zip(*runs, strict=True)))
    scatter = 0.05 * np.random.default_rng(7).standard_normal(sets)
    scatter[0] = 0.0
    deflection, acceleration = np.array(layout.deflection_axles), np.array(layout.acceleration_axles)

    def one(factor: jax.Array, c: RunConstants, tolerance: jax.Array) -> jax.Array:
        c = c._replace(stiffness=c.stiffness * factor)
        nb, na = c.position.shape[1], c.rest.shape[0]
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, args: _rates(t, y, c)[0]),
            diffrax.Tsit5(),
            times[0],
            times[-1],
            1e-3,
            jnp.zeros(2 * (nb + na)),
            saveat=diffrax.SaveAt(ts=jnp.asarray(times)),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=ABSOLUTE * tolerance, dtmax=MAX_STEP_S),
            max_steps=100_000,
        )
        rates, extension = jax.vmap(lambda t, y: _rates(t, y, c))(jnp.asarray(times), found.ys)
        body, axle = rates[:, nb + na : 2 * nb + na], rates[:, 2 * nb + na :]
        return jnp.concatenate([extension[:, deflection], axle[:, acceleration], body @ c.body_rows.T], axis=1)

    together = jax.vmap(jax.vmap(one, in_axes=(None, 0, None), out_axes=1), in_axes=(0, None, None), out_axes=1)
    compiled = jax.jit(lambda tolerance: together(jnp.exp(jnp.asarray(scatter)), stacked, tolerance))
    return lambda tolerance: acquisition.shown(np.asarray(compiled(jnp.asarray(tolerance))))
