"""From the parameter vector to the suspension and tire laws of every axle in every pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from sysid.arrays import Axles, RunsByAxles
from sysid.campaign.statics import carried_by_suspensions
from sysid.campaign.vehicle_records import Vehicle
from sysid.estimation.parameters.parameter_set import SHARE_ODDS, ParameterSet, bending_names
from sysid.estimation.parameters.suspension_curves import (
    SuspensionCurves,
    helper_ramps,
    joined_ramps,
    joined_stops,
    lash_ramps,
    stop_ramps,
    suspension_curves,
    table_ramps,
)
from sysid.estimation.parameters.suspension_elements import coefficients, law_elements, quantities
from sysid.vehicle_model.contact import TireLaw, tire_law
from sysid.vehicle_model.device_arrays import HostOrDevice, ParametersBySets, RunsByAxlesBySets, numpy_of
from sysid.vehicle_model.passes import PassBatch
from sysid.vehicle_model.suspension import FrameLaw, SuspensionLaw


class ElementIndex(NamedTuple):
    """Position of an element's quantity in the parameter vector, (na,), and its neutral value.

    Axles without the element have position -1 and take the neutral value.
    """

    position: Axles
    neutral: Axles


class RockerShares(NamedTuple):
    """Load share of every axle's rocker, (na,): the position of its odds in the parameter vector, else a fixed value.

    Axles with position -1 take the fixed share: 0 without a rocker.
    """

    position: Axles
    fixed: Axles


class FramePositions(NamedTuple):
    """Positions of frequency [Hz] and damping ratio of every bending frame in the parameter vector, (nf,) each.

    Frames that are no parameters have position -1 and take the fixed values.
    """

    frequency: np.ndarray
    damping: np.ndarray
    fixed_frequency: np.ndarray
    fixed_damping: np.ndarray


class LawInputs(NamedTuple):
    """What turns parameters into laws; positions in the parameter vector and constants of R passes.

    - `stiffness` (R, na);
    - `damping`, `tire_stiffness`, `tire_damping` (na,);
    - `exponent` ();
    - `elements` by quantity;
    - `curves` declared by the campaign file;
    - `static_load`, `reference_load`, `carried_load` (R, na, 1) [N]: road load in its pass and in the first load case,
      load on the suspension;
    - `load_growth` (R, na, 1): load on the suspension over that in the first load case;
    - `tire_factor` (R, na, 1): factor on the tire stiffness of a pass;
    - `tire_growth` (R, na, 1): how the damping of tires grows with their contact, as in `TireLaw`;
    - `shares` of rockers and positions of bending `frames`, None without any;
    - `trailing` (na,): how far wheels go aft over their jounce, None where none does.
    """

    stiffness: RunsByAxles
    damping: Axles
    tire_stiffness: Axles
    tire_damping: Axles
    exponent: np.ndarray
    elements: Mapping[str, ElementIndex]
    curves: SuspensionCurves
    static_load: np.ndarray
    reference_load: np.ndarray
    carried_load: np.ndarray
    load_growth: np.ndarray
    tire_factor: np.ndarray
    tire_growth: np.ndarray
    shares: RockerShares | None = None
    frames: FramePositions | None = None
    trailing: Axles | None = None


def stiffness_positions(parameters: ParameterSet, axles: int, load_cases: list[str]) -> np.ndarray:
    """Positions (R, na) of every pass's stiffness; `load_cases` names the load case of each pass."""
    return np.array([[parameters.index("stiffness", i, case) for i in range(axles)] for case in load_cases])


def law_inputs(vehicle: Vehicle, parameters: ParameterSet, batch: PassBatch, load_cases: list[str]) -> LawInputs:
    """Positions of the parameters of each axle in each pass; `load_cases` names the load case of each pass."""
    axles = range(len(vehicle.axles))

    def per_axle(quantity: str) -> np.ndarray:
        return np.array([parameters.index(quantity, i) for i in axles])

    stiffness = stiffness_positions(parameters, len(axles), load_cases)
    laws = [law_elements(parameters.parameters[i].law) for i in stiffness[0]]
    elements: dict[str, ElementIndex] = {}
    for quantity, neutral, shared in sorted(
        {(q.quantity, q.neutral, q.shared) for law in laws for q in quantities(law)}
    ):
        having = [any(q.quantity == quantity for q in quantities(laws[i])) for i in axles]
        position = [parameters.index(quantity, None if shared else i) if having[i] else -1 for i in axles]
        elements[quantity] = ElementIndex(np.array(position), np.full(len(position), neutral))
    carried = batch.matrices.carried_load
    reference = carried[..., 0] + (batch.reference_load - batch.matrices.static_load)[..., 0] @ carried_by_suspensions(
        vehicle
    )
    return LawInputs(
        stiffness,
        per_axle("damping"),
        per_axle("tire_stiffness"),
        per_axle("tire_damping"),
        np.array(parameters.index("tire_exponent")),
        elements,
        suspension_curves(vehicle.axles, laws, carried[..., 0], reference),
        batch.matrices.static_load,
        batch.reference_load,
        carried,
        carried / reference[..., None],
        np.ones_like(carried),
        np.ones_like(carried),
        _rocker_shares(vehicle, parameters),
        _frame_positions(vehicle, parameters),
    )


def _frame_positions(vehicle: Vehicle, parameters: ParameterSet) -> FramePositions | None:
    bent = [(bending_names(body.name), body.bending) for body in vehicle.bodies if body.bending is not None]
    if not bent:
        return None
    place = {name: i for i, name in enumerate(parameters.names)}
    at = np.array([[place.get(name, -1) for name in pair] for pair, _ in bent])
    fixed = np.array([[bending.frequency_hz, bending.damping_ratio] for _, bending in bent])
    return FramePositions(at[:, 0], at[:, 1], fixed[:, 0], fixed[:, 1])


def _rocker_shares(vehicle: Vehicle, parameters: ParameterSet) -> RockerShares | None:
    if not vehicle.equalisers:
        return None
    shares = RockerShares(np.full(len(vehicle.axles), -1), np.zeros(len(vehicle.axles)))
    for rocker in vehicle.equalisers:
        members = list(rocker.axles)
        if rocker.load_share is None:
            shares.position[members] = parameters.index(SHARE_ODDS, members[0])
        else:
            shares.fixed[members] = rocker.load_share
    return shares


def axle_laws(inputs: LawInputs, log_parameters: ParametersBySets) -> tuple[SuspensionLaw, TireLaw]:
    """Suspension and tire laws (R, na, S) of every axle in every pass from the log parameters (p, S).

    By NumPy, or by JAX where the parameters are its own.
    """
    xp = numpy_of(log_parameters)
    # Far from the optimum a set may overflow: its simulation is not finite, and it is rejected for that.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = xp.exp(log_parameters)
        tire = tire_law(
            values[inputs.tire_stiffness] * inputs.tire_factor,
            values[inputs.tire_damping],
            values[inputs.exponent],
            inputs.static_load,
            inputs.reference_load,
        )
        stiffness = values[inputs.stiffness]
        damping = xp.broadcast_to(values[inputs.damping], stiffness.shape)
        return _suspension(inputs, values, stiffness, damping), tire._replace(growth=inputs.tire_growth)


def laws_side_by_side(models: Sequence[LawInputs], sets: Sequence[ParametersBySets]) -> tuple[SuspensionLaw, TireLaw]:
    """Laws (R K, na, 1) of K models of R passes; the K laws of a pass follow each other.

    Parameters
    ----------
    models : of one structure; sets : log parameters (p, 1) of each.
    """
    suspensions, tires = zip(*map(axle_laws, models, sets), strict=True)
    shape = suspensions[0].stiffness.shape

    def as_passes(*of_models: np.ndarray) -> np.ndarray:
        # K times ([ramps,] R, axles, 1) become ([ramps,] R K, axles, 1).
        by_pass = np.stack(of_models, axis=-3)
        return by_pass.reshape(*by_pass.shape[:-4], -1, *by_pass.shape[-2:])

    whole = [tire._make(np.broadcast_to(value, shape) for value in tire) for tire in tires]
    return jax.tree.map(as_passes, *suspensions), jax.tree.map(as_passes, *whole)


def _suspension(
    inputs: LawInputs, values: HostOrDevice, stiffness: RunsByAxlesBySets, damping: RunsByAxlesBySets
) -> SuspensionLaw:
    xp = numpy_of(values)

    def element(quantity: str) -> Any:
        if quantity not in inputs.elements:
            return None
        position, neutral = inputs.elements[quantity]
        of_axle = xp.where(position[:, None] >= 0, values[position], neutral[:, None])
        return xp.broadcast_to(of_axle, stiffness.shape)

    given: dict[str, HostOrDevice] = {}
    for q in coefficients():
        value = element(q.quantity)
        if q.field is not None and value is not None:
            loads = (inputs.carried_load, inputs.load_growth)
            given[q.field] = value if q.coefficient is None else q.coefficient(value, stiffness, *loads)
    if inputs.trailing is not None:
        given["trailing"] = xp.broadcast_to(inputs.trailing[:, None], stiffness.shape)
    if inputs.shares is not None:
        position, fixed = inputs.shares
        odds = values[position]
        share = xp.where(position[:, None] >= 0, odds / (1.0 + odds), fixed[:, None])
        given["load_share"] = xp.broadcast_to(share, stiffness.shape)
    frames = None
    if inputs.frames is not None:
        at = inputs.frames
        frequency = xp.where(at.frequency[:, None] >= 0, values[at.frequency], at.fixed_frequency[:, None])
        ratio = xp.where(at.damping[:, None] >= 0, values[at.damping], at.fixed_damping[:, None])
        turn = 2.0 * xp.pi * frequency
        shape = (stiffness.shape[0], *turn.shape)
        frames = FrameLaw(xp.broadcast_to(turn**2, shape), xp.broadcast_to(2.0 * ratio * turn, shape))
    curves, ramps, base, stop = inputs.curves, [], stiffness, element("stop_stiffness")
    if curves.spring is not None:
        ramps.append(table_ramps(curves.spring, stiffness))
        base = stiffness * curves.spring.share
    if curves.lash is not None:
        ramps.append(lash_ramps(curves.lash, stiffness, inputs.carried_load))
    helper, travel = element("helper_stiffness"), element("helper_travel")
    if helper is not None and travel is not None:
        further = inputs.carried_load * (1.0 - 1.0 / inputs.load_growth)
        slope, ramp = helper_ramps(helper, travel, stiffness, further)
        base = base + slope - stiffness
        ramps.append(ramp)
    damper = curves.damper
    stops: HostOrDevice | None = curves.stops
    jounce, rebound = element("jounce_travel"), element("rebound_travel")
    if jounce is not None and rebound is not None:
        stops = joined_stops(stops, jounce, rebound)
    return SuspensionLaw(
        base,
        damping if damper is None else damping * damper.share,
        ramps=joined_ramps(ramps) if ramps else None,
        stops=None if stops is None or stop is None else stop_ramps(stops, stop),
        rate_ramps=None if damper is None else table_ramps(damper, damping),
        frames=frames,
        **given,
    )
