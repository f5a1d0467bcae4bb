"""Time integration of the planar vehicle over a bump, many runs and parameter sets at once.

Every state array has the shape (R runs, degrees of freedom, S sets), the sets contiguous, so that the kinematics of a
stage are three small batched matrix products and the rest is elementwise. The classical fourth-order Runge-Kutta scheme
in its second-order (Nystrom) form advances positions and velocities; the integral of each clipped tire force over the
step is corrected exactly at lift-off (:mod:`sysid.vehicle_model.kink`). Everything that does not depend on the state is
computed before the loop.

Links lead the wheel of axle i aft by b_i times its jounce. With the extension e_i, its rate v_i and the horizontal tire
force H_i, the wheel is b_i e_i further ahead and b_i v_i faster than without. The body holds it against H_i and against
its own mass m_ui, with a pull along its slope:

    (1 + b_i^2) m_ui z_i'' = V_i - static load + S_i + D_i - b_i H_i + m_ui (b_i t_i + b_i^2 a_i) q'',
    on the body  H_i + X_i  forward at the wheel,  S_i + D_i - b_i (H_i + X_i - m_ui t_i q'')  as pull,
    X_i = b_i m_ui (z_i'' - a_i q''),

t_i q and a_i q the motion of the body at wheel and suspension. Accelerations of bodies and wheels depend on each other:
they are computed with q'' = 0 in these terms, and then once more.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.errors import SysidError
from sysid.vehicle_model.contact import RoadInput, TireLaw, contact_force
from sysid.vehicle_model.device_arrays import AxleHistories, ChannelHistories, RunsByAxlesBySets
from sysid.vehicle_model.filters import FilterRecursion, filter_memory, filtered, next_memory
from sysid.vehicle_model.kink import clipped_integrals
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.stacked_matrices import StackedMatrices
from sysid.vehicle_model.suspension import (
    SuspensionLaw,
    has_kinks,
    kink_corrections,
    suspension_force,
)
from sysid.vehicle_model.suspension_states import (
    Extension,
    SuspensionStates,
    states_after_step,
    states_at_rest,
    states_at_stage,
)


class SensorLayout(NamedTuple):
    """Which signals are observed: indices of axles with a deflection sensor and with an accelerometer."""

    deflection_axles: tuple[int, ...]
    acceleration_axles: tuple[int, ...]


class Histories(NamedTuple):
    """Unfiltered histories at the output times.

    - `deflection` (T, R, na, S): suspension extension above the axle [m];
    - `axle_acceleration` (T, R, na, S): [m/s2];
    - `tire_force`, `horizontal_force` (T, R, na, S): total vertical and forward tire force [N];
    - `suspension_force` (T, R, na, S): on the body, less its preload [N] (of an axle group at its first axle);
    - `body_acceleration` (T, R, nr, S): [m/s2];
    - `body` (T, R, nb, S): body coordinates.
    """

    deflection: AxleHistories
    axle_acceleration: AxleHistories
    body_acceleration: jax.Array
    tire_force: AxleHistories
    horizontal_force: AxleHistories
    suspension_force: AxleHistories
    body: jax.Array


#: The road under wheels at a time [s] that are so far ahead (R, na, S) [m] of their places at the speed that is held.
AtWheels = Callable[[jax.Array, jax.Array], RoadInput]


class _State(NamedTuple):
    body: jax.Array
    body_rate: jax.Array
    axle: jax.Array
    axle_rate: jax.Array
    inner: SuspensionStates


class _Forces(NamedTuple):
    """Forces and accelerations of one stage; `axle_acceleration`, `extension` and `rate` at unsprung coordinates.

    `damper_rate` are the rates of the dampers, `body_rate` those of the body coordinates in that stage.
    """

    body_acceleration: jax.Array
    axle_acceleration: AxleHistories
    unclipped: jax.Array
    horizontal: jax.Array
    pull: jax.Array
    extension: jax.Array
    rate: jax.Array
    damper_rate: jax.Array
    body_rate: jax.Array


def _forces(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    road: RoadInput,
    time_s: jax.Array,
    state: _State,
    inner_at: Callable[[Extension], SuspensionStates] | None = None,
    at_wheels: AtWheels | None = None,
) -> _Forces:
    """Forces of a state; `inner_at` gives the states inside suspensions of a stage, None keeps the state's.

    `road` is at the speed that is held, unless it is looked up `at_wheels`.
    """
    axles = matrices.static_load.shape[1]
    shift = jnp.matmul(matrices.position, state.body)
    drift = jnp.matmul(matrices.rate, state.body_rate)
    nominal = motion.speed_at(time_s)
    advance = shift[:, axles : 2 * axles]
    speed = drift[:, axles : 2 * axles] + nominal[:, None]
    extension = shift[:, :axles] - state.axle
    rate = drift[:, :axles] - state.axle_rate
    if suspension.trailing is not None:
        advance, speed = advance + suspension.trailing * extension, speed + suspension.trailing * rate
    if at_wheels is not None:
        known = jax.lax.stop_gradient(advance)
        road, advance = at_wheels(time_s, known), advance - known
    if motion.change is not None:
        road = road.shifted(motion.ahead(motion.change, time_s)[:, None])
        speed = speed + motion.faster(motion.change, time_s)[:, None]
    unclipped, drag = contact_force(
        tire, road, advance, speed, _at_wheels(matrices, state.axle), _at_wheels(matrices, state.axle_rate)
    )
    vertical = jnp.maximum(unclipped, 0.0)
    horizontal = drag * vertical
    inner = state.inner if inner_at is None else inner_at(Extension(extension, rate))
    damper_rate = rate if inner.damper_rate is None else inner.damper_rate
    pull = _carried(matrices, suspension_force(suspension, extension, damper_rate, inner.slip, matrices.sharing))
    along_links: jax.Array | float = 0.0 if suspension.trailing is None else suspension.trailing * horizontal
    axle = _unsprung_acceleration(matrices, vertical - along_links - matrices.static_load, pull)
    pulled, pushed = pull, horizontal
    if suspension.trailing is not None:
        axle = axle / (1.0 + suspension.trailing**2)
        pushed = horizontal + suspension.trailing * axle / matrices.inverse_unsprung
        pulled = pull - suspension.trailing * pushed
    body = (
        jnp.matmul(matrices.acceleration, jnp.concatenate([pulled, pushed], axis=1))
        + shift[:, 2 * axles :]
        + drift[:, 2 * axles :]
    )
    if matrices.frames is not None and suspension.frames is not None:
        amplitude, swing = (jnp.matmul(matrices.frames.select, x) for x in (state.body, state.body_rate))
        straightening = suspension.frames.stiffness * amplitude + suspension.frames.damping * swing
        body = body + jnp.matmul(matrices.frames.push, straightening)
    if suspension.trailing is not None:
        above, along = jnp.split(jnp.matmul(matrices.position[:, : 2 * axles], body), 2, axis=1)
        carried = suspension.trailing * (along + suspension.trailing * above) / (1.0 + suspension.trailing**2)
        axle = axle + carried
        further = suspension.trailing * (carried - above)
        more = jnp.concatenate([-suspension.trailing * (further - along), further], axis=1)
        unsprung = jnp.concatenate([matrices.inverse_unsprung] * 2, axis=1)
        body = body + jnp.matmul(matrices.acceleration, more / unsprung)
    return _Forces(body, axle, unclipped, horizontal, pull, extension, rate, damper_rate, state.body_rate)


def _at_wheels(matrices: StackedMatrices, motion: jax.Array) -> jax.Array:
    """Motion of the wheels, or above them, from that at the unsprung coordinates."""
    return motion if matrices.beams is None else jnp.matmul(matrices.beams.wheel, motion)


def _carried(matrices: StackedMatrices, pull: jax.Array) -> jax.Array:
    """Suspension force, zero where a group's suspension stands at another axle."""
    return pull if matrices.beams is None else jnp.asarray(matrices.beams.carries * pull)


def _unsprung_acceleration(matrices: StackedMatrices, tire: jax.Array, pull: jax.Array | None = None) -> jax.Array:
    """Accelerations of the unsprung coordinates from vertical tire force and suspension pull, if any."""
    if matrices.beams is None:
        return jnp.asarray(matrices.inverse_unsprung * (tire if pull is None else tire + pull))
    push = jnp.matmul(matrices.beams.tire, tire)
    return push if pull is None else push + jnp.matmul(matrices.beams.pull, pull)


def _stages(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    roads: list[RoadInput],
    time_s: jax.Array,
    h: float,
    state: _State,
    first: _Forces,
    at_wheels: AtWheels | None,
) -> tuple[_Forces, _Forces, _Forces, _Forces]:
    """Forces of the four stages of a Nystrom step from `state`, whose forces are `first`."""
    half = 0.5 * h
    b, vb, z, vz, inner = state

    def forces(
        road: RoadInput,
        tau: float,
        body: jax.Array,
        body_rate: jax.Array,
        axle: RunsByAxlesBySets,
        axle_rate: RunsByAxlesBySets,
        middle_rate: RunsByAxlesBySets | None = None,
    ) -> _Forces:
        start = Extension(first.extension, first.rate)
        inner_at = partial(states_at_stage, suspension, inner, start, tau, middle_rate=middle_rate)
        stage = _State(body, body_rate, axle, axle_rate, inner)
        return _forces(matrices, suspension, tire, motion, road, time_s + tau, stage, inner_at, at_wheels)

    middle_b, middle_z = b + half * vb, z + half * vz
    second = forces(
        roads[1],
        half,
        middle_b,
        vb + half * first.body_acceleration,
        middle_z,
        vz + half * first.axle_acceleration,
    )
    third = forces(
        roads[1],
        half,
        middle_b + half * half * first.body_acceleration,
        vb + half * second.body_acceleration,
        middle_z + half * half * first.axle_acceleration,
        vz + half * second.axle_acceleration,
    )
    fourth = forces(
        roads[2],
        h,
        b + h * (vb + half * second.body_acceleration),
        vb + h * third.body_acceleration,
        z + h * (vz + half * second.axle_acceleration),
        vz + h * third.axle_acceleration,
        0.5 * (second.rate + third.rate),
    )
    return first, second, third, fourth


def _step(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    roads: list[RoadInput],
    time_s: jax.Array,
    h: float,
    state: _State,
    first: _Forces,
    at_wheels: AtWheels | None,
) -> tuple[_State, _Forces]:
    """One Nystrom step from `state`, whose forces are `first`; returns the new state and the mid-step forces."""
    b, vb, z, vz, inner = state
    stages = _stages(matrices, suspension, tire, motion, roads, time_s, h, state, first, at_wheels)
    _, second, third, _ = stages
    impulse, moment = _missed_by_stages(matrices, suspension, stages)

    def advance(
        x: jax.Array, v: jax.Array, a1: jax.Array, a2: jax.Array, a3: jax.Array, a4: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        return x + h * v + h * h / 6.0 * (a1 + a2 + a3), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

    new_b, new_vb = advance(b, vb, *(f.body_acceleration for f in stages))
    new_z, new_vz = advance(z, vz, *(f.axle_acceleration for f in stages))
    middle = _Forces(*(0.5 * (p + q) for p, q in zip(second, third, strict=True)))
    # At a corner the filter's quadratic through start, middle and end then has the exact impulse of the force.
    middle = middle._replace(axle_acceleration=middle.axle_acceleration + 1.5 * impulse.axle)
    new_z, new_vz = new_z + h * h * moment.axle, new_vz + h * impulse.axle
    if impulse.body is not None and moment.body is not None:
        new_b, new_vb = new_b + h * h * moment.body, new_vb + h * impulse.body
        middle = middle._replace(body_acceleration=middle.body_acceleration + 1.5 * impulse.body)
    if any(state is not None for state in inner):
        axles = matrices.static_load.shape[1]
        end = Extension(
            jnp.matmul(matrices.position[:, :axles], new_b) - new_z,
            jnp.matmul(matrices.position[:, :axles], new_vb) - new_vz,
        )
        inner = states_after_step(suspension, inner, Extension(first.extension, first.rate), end, h)
    return _State(new_b, new_vb, new_z, new_vz, inner), middle


class _Missed(NamedTuple):
    """Mean acceleration, or its first moment over the step, that the stages miss; `body` None where it is zero."""

    axle: jax.Array
    body: jax.Array | None


def _missed_by_stages(
    matrices: StackedMatrices, suspension: SuspensionLaw, stages: tuple[_Forces, ...]
) -> tuple[_Missed, _Missed]:
    """Corrections for the corners of tire contact and suspension law within one step."""
    phi = tuple(f.unclipped for f in stages)
    f1, f2, f3, f4 = (jnp.maximum(p, 0.0) for p in phi)
    impulse, moment = clipped_integrals(phi[0], 0.5 * (phi[1] + phi[2]), phi[3])
    impulse = impulse - (f1 + 2.0 * f2 + 2.0 * f3 + f4) / 6.0
    moment = moment - (f1 + f2 + f3) / 6.0
    if not has_kinks(suspension):
        return (
            _Missed(_unsprung_acceleration(matrices, impulse), None),
            _Missed(_unsprung_acceleration(matrices, moment), None),
        )
    arguments = tuple(f.extension for f in stages), tuple(f.damper_rate for f in stages)
    corrections = kink_corrections(suspension, *arguments, matrices.sharing)
    missed = tuple(_carried(matrices, one) for one in corrections)
    turn = matrices.acceleration[:, :, : matrices.static_load.shape[1]]
    return (
        _Missed(_unsprung_acceleration(matrices, impulse, missed[0]), jnp.matmul(turn, missed[0])),
        _Missed(_unsprung_acceleration(matrices, moment, missed[1]), jnp.matmul(turn, missed[1])),
    )


def _observe(matrices: StackedMatrices, layout: SensorLayout, forces: _Forces) -> jax.Array:
    """Signals at the sensors (R, channels, S): deflections, axle accelerations, body accelerations, pitch rates."""
    parts = [
        _at_wheels(matrices, forces.extension)[:, np.array(layout.deflection_axles, int)],
        _at_wheels(matrices, forces.axle_acceleration)[:, np.array(layout.acceleration_axles, int)],
        jnp.matmul(matrices.body_rows, forces.body_acceleration),
    ]
    if matrices.rate_rows is not None:
        parts.append(jnp.matmul(matrices.rate_rows, forces.body_rate))
    return jnp.concatenate(parts, axis=1)


def observed(layout: SensorLayout, matrices: StackedMatrices) -> int:
    """Number of the signals that are observed."""
    rates = 0 if matrices.rate_rows is None else matrices.rate_rows.shape[1]
    axles = len(layout.deflection_axles) + len(layout.acceleration_axles)
    return axles + int(matrices.body_rows.shape[1]) + rates


def _step_slices(road: RoadInput, steps: int) -> RoadInput:
    """Road input regrouped as (steps, 3, ...): start, middle and end of every step."""
    index = np.arange(steps)[:, None] * 2 + np.arange(3)
    slices: RoadInput = jax.tree.map(lambda values: values[index], road)
    return slices


def stage_times(samples: int, interval_s: float, substeps: int) -> np.ndarray:
    """Times [s] at which the road input is needed: every half step, (2 substeps samples + 1,)."""
    return np.arange(2 * substeps * samples + 1) * (interval_s / (2 * substeps))


def _start(matrices: StackedMatrices, suspension: SuspensionLaw) -> _State:
    runs, axles, _ = matrices.static_load.shape
    sets = suspension.stiffness.shape[-1]
    body = jnp.zeros((runs, matrices.body_rows.shape[2], sets))
    axle = jnp.zeros((runs, axles, sets))
    if body.dtype != jnp.float64:
        raise SysidError(
            "The simulation needs 64-bit floats; call jax.config.update('jax_enable_x64', True) before the first use."
        )
    return _State(body, body, axle, axle, states_at_rest(suspension, axle))


def simulate_sensors(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    road: RoadInput,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    *,
    interval_s: float,
    substeps: int,
    at_wheels: AtWheels | None = None,
) -> ChannelHistories:
    """What the sensors show at every sample, through the acquisition's filter.

    Parameters
    ----------
    matrices : of the R runs.
    suspension, tire, motion : laws and motion of every run with every set.
    road : road input at :func:`stage_times`, leading axis 2 substeps T + 1.
    layout : observed signals, C channels in all.
    recursion : the anti-alias filter for the integration step, None for unfiltered signals.
    interval_s, substeps : sample interval [s] and integration steps per sample.
    at_wheels : how the road is looked up where wheels are; without it `road` leads there by its Taylor series.

    Returns
    -------
    (T, R, C, S) deflections [m], accelerations [m/s2] and pitch rates [rad/s], from static equilibrium at time zero.
    """
    samples = (road.rise.shape[0] - 1) // (2 * substeps)
    h = interval_s / substeps
    sets = suspension.stiffness.shape[-1]
    state = _start(matrices, suspension)
    channels = observed(layout, matrices)
    memory = filter_memory(recursion, (matrices.static_load.shape[0], channels, sets))

    def body(
        carry: tuple[_State, jax.Array], inputs: tuple[jax.Array, RoadInput]
    ) -> tuple[tuple[_State, jax.Array], jax.Array]:
        state, memory = carry
        number, stages = inputs
        at = number * h
        stage = [jax.tree.map(lambda v, k=k: v[k], stages) for k in range(3)]
        first = _forces(matrices, suspension, tire, motion, stage[0], at, state, at_wheels=at_wheels)
        state, middle = _step(matrices, suspension, tire, motion, stage, at, h, state, first, at_wheels)
        now = _observe(matrices, layout, first)
        if recursion is None:
            return (state, memory), now
        shown = filtered(recursion, memory, now)
        return (state, next_memory(recursion, memory, now, _observe(matrices, layout, middle))), shown

    steps = jnp.arange(samples * substeps, dtype=jnp.float64)
    _, shown = jax.lax.scan(body, (state, memory), (steps, _step_slices(road, samples * substeps)))
    return jnp.asarray(shown[::substeps])


def simulate_histories(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    road: RoadInput,
    *,
    interval_s: float,
    substeps: int,
    at_wheels: AtWheels | None = None,
) -> Histories:
    """Unfiltered motion and forces at every output interval; arguments as in :func:`simulate_sensors`."""
    samples = (road.rise.shape[0] - 1) // (2 * substeps)
    h = interval_s / substeps
    state = _start(matrices, suspension)

    def body(state: _State, inputs: tuple[jax.Array, RoadInput]) -> tuple[_State, Histories]:
        number, stages = inputs
        at = number * h
        stage = [jax.tree.map(lambda v, k=k: v[k], stages) for k in range(3)]
        first = _forces(matrices, suspension, tire, motion, stage[0], at, state, at_wheels=at_wheels)
        record = Histories(
            deflection=_at_wheels(matrices, first.extension),
            axle_acceleration=_at_wheels(matrices, first.axle_acceleration),
            body_acceleration=jnp.matmul(matrices.body_rows, first.body_acceleration),
            tire_force=jnp.maximum(first.unclipped, 0.0),
            horizontal_force=first.horizontal,
            suspension_force=-first.pull,
            body=state.body,
        )
        state, _ = _step(matrices, suspension, tire, motion, stage, at, h, state, first, at_wheels)
        return state, record

    steps = jnp.arange(samples * substeps, dtype=jnp.float64)
    histories = jax.lax.scan(body, state, (steps, _step_slices(road, samples * substeps)))[1]
    return Histories(*(values[::substeps] for values in histories))
