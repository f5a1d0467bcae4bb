"""Force against displacement and rate of the calibrated suspensions, as a test rig would record them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.law_choice import laws_from_names
from sysid.estimation.parameters.axle_laws import axle_laws, law_inputs
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.sdof.drop_results import DropSummary
from sysid.tabular import Tabular
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import TireLaw, effective_road
from sysid.vehicle_model.passes import PassBatch
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import SuspensionLaw, suspension_force
from sysid.vehicle_model.suspension_states import Extension, SuspensionStates, states_after_step, states_at_rest

if TYPE_CHECKING:
    import pandas as pd

#: Harmonic motion of the rig: a stroke and a frequency that suspensions see on a bump (damper speeds to 0.4 m/s).
AMPLITUDE_M = 0.03
FREQUENCY_HZ = 2.0
#: Steps of a cycle, for smooth curves.
_STEPS = 400


@dataclass(frozen=True)
class SuspensionLoops(Tabular):
    """One cycle of harmonic motion of every suspension in one load case.

    - `extension_m`, `rate_m_s` (n,) from static rest;
    - `force_N` (suspensions, n): on the body less its static part, positive when it pulls axle and body together;
    - `axles`: their axle indices and `laws` their laws;
    - `amplitude_m`, `frequency_hz` of the motion.
    """

    load_case: str
    extension_m: np.ndarray
    rate_m_s: np.ndarray
    force_N: np.ndarray
    axles: tuple[int, ...]
    laws: tuple[str, ...]
    amplitude_m: float = AMPLITUDE_M
    frequency_hz: float = FREQUENCY_HZ

    def summary(self) -> pd.DataFrame:
        """Extension [m], rate [m/s] and the force of each axle [N], one row per instant."""
        import pandas as pd

        forces = {f"force_{axle + 1}_N": f for axle, f in zip(self.axles, self.force_N, strict=True)}
        return pd.DataFrame({"extension_m": self.extension_m, "rate_m_s": self.rate_m_s, **forces})


def calibrated_laws(
    campaign: Campaign, drops: DropSummary | None, fit: FitResult, load_case: str, values: Mapping[str, float]
) -> tuple[SuspensionLaw, TireLaw, np.ndarray]:
    """Laws of all suspensions and tires in a load case, arrays (1, axles, 1), and the loads carried (axles,) [N].

    Parameters
    ----------
    drops : the drop analysis that the fit started from, or None.
    values : parameter values by name in place of the least-squares ones.

    Raises
    ------
    KeyError
        If the load case has no stiffness of its own because nobody drove in it.
    """
    parameters = campaign_parameters(campaign, drops, laws_from_names(campaign.vehicle, fit.laws))
    vehicle = campaign.vehicle
    first = next(iter(campaign.load_cases.values()))
    reference = np.array(first.axle_loads_kg)[None, :, None] * vehicle.gravity_m_s2
    matrices = stack_matrices([assemble(vehicle, campaign.load_cases[load_case], first)], [])
    station = np.arange(-20.0, 20.0) * 0.1
    flat = effective_road(station, np.zeros((1, len(vehicle.axles), station.size)))
    batch = PassBatch(matrices, flat, np.array([a.x_m for a in vehicle.axles])[:, None], reference)
    fitted = {p.name: p.value for p in fit.parameters} | dict(values)
    logs = np.log([fitted.get(p.name, p.start) for p in parameters.parameters])[:, None]
    law, tire = axle_laws(law_inputs(vehicle, parameters, batch, [load_case]), logs)
    if fit.tire_growth:
        tire = tire._replace(growth=np.array(fit.tire_growth)[None, :, None])
    return law, tire, np.asarray(matrices.carried_load[0, :, 0])


@jax.jit
def _forces(law: SuspensionLaw, extension: np.ndarray, rate: np.ndarray, step_s: float) -> jax.Array:
    """Forces (n - 1, suspensions) [N] at all but the first of n extensions [m] and rates [m/s], friction at zero first.

    Parameters
    ----------
    law : of one load case and one parameter set, arrays (1, suspensions, 1).
    """
    shape = law.stiffness.shape

    def at(k: jax.Array) -> Extension:
        return Extension(*(jnp.broadcast_to(jnp.asarray(x)[k], shape) for x in (extension, rate)))

    def step(inner: SuspensionStates, k: jax.Array) -> tuple[SuspensionStates, jax.Array]:
        inner = states_after_step(law, inner, at(k - 1), at(k), step_s)
        damper_rate = at(k).rate if inner.damper_rate is None else inner.damper_rate
        return inner, suspension_force(law, at(k).value, damper_rate, inner.slip)[0, :, 0]

    return jax.lax.scan(step, states_at_rest(law, jnp.zeros(shape)), jnp.arange(1, len(extension)))[1]


def suspension_loops(
    campaign: Campaign,
    drops: DropSummary | None,
    fit: FitResult,
    load_case: str,
) -> SuspensionLoops:
    """Second cycle of e = A sin(2 pi f t) of every suspension with the least-squares laws, friction settled.

    A = `AMPLITUDE_M`, f = `FREQUENCY_HZ`.

    Parameters
    ----------
    drops : the drop analysis that the fit started from, or None.

    Raises
    ------
    KeyError
        If the load case has no stiffness of its own because nobody drove in it.
    """
    vehicle = campaign.vehicle
    law, _, _ = calibrated_laws(campaign, drops, fit, load_case, {})
    time = np.arange(2 * _STEPS + 1) / (_STEPS * FREQUENCY_HZ)
    turn = 2.0 * np.pi * FREQUENCY_HZ
    extension, rate = AMPLITUDE_M * np.sin(turn * time), AMPLITUDE_M * turn * np.cos(turn * time)
    forces = np.asarray(_forces(law, extension, rate, float(time[1])))[_STEPS - 1 :]
    # Suspensions of grouped axles stand at the first axle of their group.
    suspended = sorted(set(vehicle.suspension_axle))
    return SuspensionLoops(
        load_case,
        extension[_STEPS:],
        rate[_STEPS:],
        forces[:, suspended].T,
        tuple(suspended),
        fit.laws,
    )
