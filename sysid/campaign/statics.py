"""Static equilibrium of the vehicle: centres of gravity and hinge loads from the axle loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import CampaignError

MASS_TOLERANCE = 0.005  # scales read to about 0.5 %, so a smaller difference cannot be told from a reading error
OVERHANG_M = 5.0  # a centre of gravity further than this outside the wheels and hinges is a typing error


@dataclass(frozen=True)
class ChainSum:
    """Axle loads under a chain of coupled `bodies` [kg], and by how much they exceed its masses."""

    bodies: tuple[int, ...]
    loads_kg: float
    difference_kg: float


@dataclass(frozen=True)
class StaticEquilibrium:
    """Forces and positions of the vehicle standing on level ground.

    - `cg_x_m` (bodies,): centre of gravity of each sprung body behind axle 1;
    - `hitch_load_N` (bodies,): load at the hinge of each body, positive = pressing down on the body in front, zero
      where uncoupled;
    - `tributary_mass_kg` (axles,): bodywork mass carried by each axle (axle load - unsprung mass);
    - `suspension_preload_N` (axles,): weight of the tributary mass;
    - `tire_load_N` (axles,): vertical road force.
    """

    cg_x_m: np.ndarray
    hitch_load_N: np.ndarray
    tributary_mass_kg: np.ndarray
    suspension_preload_N: np.ndarray
    tire_load_N: np.ndarray


def chains(vehicle: Vehicle) -> list[list[int]]:
    """Indices of the bodies of each chain, front to rear; a body without hitch keys starts a new one."""
    result: list[list[int]] = []
    for index, body in enumerate(vehicle.bodies):
        if index == 0 or body.hitch_x_m is None:
            result.append([index])
        else:
            result[-1].append(index)
    return result


def carried_by_suspensions(vehicle: Vehicle) -> np.ndarray:
    """Matrix (axles, axles) that adds up the loads of the axles of a group: their suspension carries them together.

    Times the load on every axle it gives the load on the suspension of every axle, the same for all axles of a group.
    """
    return np.equal.outer(vehicle.suspension_axle, vehicle.suspension_axle).astype(float)


def _tributary_mass(vehicle: Vehicle, load_case: LoadCase) -> np.ndarray:
    return np.asarray(np.array(load_case.axle_loads_kg, float) - np.array(vehicle.unsprung_mass_kg, float))


def chain_sums(vehicle: Vehicle, load_case: LoadCase) -> list[ChainSum]:
    """Sum of the axle loads of every chain that has axles, less unsprung, beam and sprung masses."""
    tributary = _tributary_mass(vehicle, load_case)
    sums = []
    for chain in chains(vehicle):
        on_chain = [i for i, axle in enumerate(vehicle.axles) if axle.body in chain]
        loads = sum(load_case.axle_loads_kg[i] for i in on_chain)
        sprung = sum(load_case.sprung_mass_kg[b] for b in chain)
        if on_chain:
            sums.append(ChainSum(tuple(chain), loads, float(tributary[on_chain].sum()) - sprung))
    return sums


def check_statics(vehicle: Vehicle, load_case: LoadCase) -> None:
    """Check that the scale readings carry the masses of each chain of coupled bodies.

    sum(axle loads) = sum(unsprung masses) + sum(sprung masses) + sum(beam masses), within 0.5 %.

    Parameters
    ----------
    vehicle, load_case : masses in kg, one axle load per axle and one sprung mass per body.

    Raises
    ------
    CampaignError
        If the sums differ (the sentence names the difference in kg), an axle carries less than its own mass, or a
        centre of gravity comes out far outside the vehicle.
    """
    tributary = _tributary_mass(vehicle, load_case)
    for axle, load, mass in zip(vehicle.axles, load_case.axle_loads_kg, tributary, strict=True):
        if mass <= 0.0:
            raise CampaignError(
                f"load case '{load_case.name}': the axle load of '{axle.name}' ({load:g} kg) does not exceed the "
                f"unsprung mass under it ({load - mass:g} kg); check axle_loads_kg, which includes the unsprung mass."
            )
    for chain in chains(vehicle):
        if not any(axle.body in chain for axle in vehicle.axles):
            names = ", ".join(vehicle.bodies[b].name for b in chain)
            raise CampaignError(
                f"the body '{names}' has neither an axle nor a hinge; give it an axle or hitch_x_m in campaign.toml."
            )
    for found in chain_sums(vehicle, load_case):
        if abs(found.difference_kg) > MASS_TOLERANCE * found.loads_kg:
            names = ", ".join(vehicle.bodies[b].name for b in found.bodies)
            raise CampaignError(
                f"load case '{load_case.name}': the axle loads under {names} sum to {found.loads_kg:g} kg, but "
                f"unsprung and sprung masses sum to {found.loads_kg - found.difference_kg:g} kg, a difference of "
                f"{found.difference_kg:+g} kg; correct axle_loads_kg, sprung_mass_kg or unsprung_mass_kg so that they "
                "agree within 0.5 %."
            )
    statics = _equilibrium(vehicle, load_case, tributary)
    supports = [a.x_m for a in vehicle.axles] + [b.hitch_x_m for b in vehicle.bodies if b.hitch_x_m is not None]
    for body, cg_x in zip(vehicle.bodies, statics.cg_x_m, strict=True):
        if not min(supports) - OVERHANG_M <= cg_x <= max(supports) + OVERHANG_M:
            raise CampaignError(
                f"load case '{load_case.name}': axle loads, sprung masses and hinge positions put the centre of "
                f"gravity of '{body.name}' at x = {cg_x:.1f} m, outside the vehicle; check "
                "sprung_mass_kg (one per body, front to rear), x_m and hitch_x_m."
            )


def static_equilibrium(vehicle: Vehicle, load_case: LoadCase) -> StaticEquilibrium:
    """Find centres of gravity and hinge loads from axle loads, masses and positions, last body first.

    The support of an axle group acts on the body at the middle of the group; differences between the axle loads of one
    group are balanced within its beam.

    For body b with hinge at x_h, suspension forces S_i at x_i and the load R of the next body at its hinge x_r: the
    vertical balance m_b g + R = sum S_i + H gives the hinge load H. The moments about the hinge, m_b g (x_cg - x_h) + R
    (x_r - x_h) = sum S_i (x_i - x_h), give x_cg. For the first body of a chain everything it carries stands on its
    wheels, so that a remainder within the tolerance of the scales moves no axle load.

    Parameters
    ----------
    vehicle, load_case : masses in kg, positions in m behind axle 1.

    Returns
    -------
    StaticEquilibrium
        Arrays by body and by axle, front to rear.

    Raises
    ------
    CampaignError
        As `check_statics`.
    """
    check_statics(vehicle, load_case)
    return _equilibrium(vehicle, load_case, _tributary_mass(vehicle, load_case))


def _equilibrium(vehicle: Vehicle, load_case: LoadCase, tributary: np.ndarray) -> StaticEquilibrium:
    g = vehicle.gravity_m_s2
    x = np.array(vehicle.suspension_x_m, float)
    body_of = np.array([a.body for a in vehicle.axles])
    support = tributary * g
    cg_x = np.zeros(len(vehicle.bodies))
    hitch = np.zeros(len(vehicle.bodies))
    for chain in chains(vehicle):
        carried, carried_x = 0.0, 0.0
        for position, b in reversed(list(enumerate(chain))):
            on_body = body_of == b
            supported = float(support[on_body].sum())
            if position == 0:
                # No hinge in front: dividing by the supported weight keeps moments in balance to the last digit.
                weight = supported - carried
                moment = float(support[on_body] @ x[on_body]) - carried * carried_x
                cg_x[b] = moment / weight if weight > 0.0 else np.inf
                continue
            hinge_x = float(vehicle.bodies[b].hitch_x_m or 0.0)
            weight = load_case.sprung_mass_kg[b] * g
            moment = float(support[on_body] @ (x[on_body] - hinge_x)) - carried * (carried_x - hinge_x)
            cg_x[b] = hinge_x + moment / weight
            hitch[b] = weight + carried - supported
            carried, carried_x = hitch[b], hinge_x
    return StaticEquilibrium(
        cg_x_m=cg_x,
        hitch_load_N=hitch,
        tributary_mass_kg=tributary,
        suspension_preload_N=support,
        tire_load_N=np.array(load_case.axle_loads_kg, float) * g,
    )
