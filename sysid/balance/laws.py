"""Suspension laws of the balance: forces as sums of known functions of measured deflections and their rates.

    F = k S(q) + c D(v) + mu W phi(q) + stop,    S = q (1 + a q / 2 + b q^2 / 3),
    D = g sgn(v) s(|v|) V / s(V),    s(v) = v / (1 + kappa v),    g = 2 r / (1 + r) longer, 2 / (1 + r) shorter,

with W the load that the suspension carries, phi Dahl's friction with slip length z, V = 0.5 m/s, and stops of one
stiffness beyond the declared travels. Rubber of softness chi in series with the damper delays what it feels by
tau = chi c: v = q' / (1 + i omega tau). Every departure from a linear spring and damper has a normal prior about zero,
so that a law is there as far as the data show it, and its doubt is in the intervals of k and c.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.vehicle_records import Axle, Vehicle
from sysid.estimation.parameters.suspension_elements import law_elements
from sysid.vehicle_model.suspension import REFERENCE_RATE_M_S

STIFFNESS, DAMPING, FRICTION, SLIP = "stiffness", "damping", "friction_share", "slip_length"
ASYMMETRY, SATURATION, SOFTNESS = "damper_asymmetry", "damper_saturation", "damper_softness"
SLOPE, CURVE, STOP = "spring_slope", "spring_curve", "stop_stiffness"
#: k and c are looked for over three decades: the prior says nothing.
_WIDE = 3.0
#: Standard deviations of departures, all assumptions: friction over the carried load (leaf packs 2 to 10 %), logarithm
#: of rebound over compression, 1/v_s [s/m], 1/stiffness of rubber [m/N], stops [N/m].
_SD = {FRICTION: 0.05, ASYMMETRY: 0.7, SATURATION: 0.7, SOFTNESS: 3e-7, STOP: 2e6}
#: Slope a [1/m] and curve b [1/m2] of a spring's rate: bellows, and leaf packs or others.
_SPRING_SD = {True: (4.0, 40.0), False: (1.5, 15.0)}
#: Slip length of friction: median [m] and standard deviation of the logarithm, as in the calibration over bumps.
SLIP_M, _SLIP_SD = 1e-3, 0.7
#: First stiffness: the static deflection of suspensions [m]; first damping [N s/m]. The search forgets them.
_STATIC_M, FIRST_DAMPING = {True: 0.08, False: 0.06}, 1.2e4
#: Elements of the campaign file that a departure belongs to.
_ELEMENT_OF = {
    FRICTION: ("friction",), SLIP: ("friction",), ASYMMETRY: ("asymmetric_damper", "bilinear_damper"),
    SATURATION: ("asymmetric_damper",), SLOPE: ("gas_spring",), CURVE: ("gas_spring",), STOP: ("bump_stops",),
    SOFTNESS: (),
}  # fmt: skip
#: Curves that are declared are not drawn here: departures follow them.
_DECLARED_CURVES = frozenset({"hanger_lash", "spring_table", "damper_table"})
UNITS = {
    STIFFNESS: "N/m", DAMPING: "N s/m", FRICTION: "1", SLIP: "m", ASYMMETRY: "1", SATURATION: "s/m", SOFTNESS: "m/N",
    SLOPE: "1/m", CURVE: "1/m2", STOP: "N/m",
}  # fmt: skip


@dataclass(frozen=True)
class Unknown:
    """One number of the balance: `quantity` of an axle (index), None for all, in a load case, None for all.

    k, c and slip length are unknown as logarithms over `unit`; `sd` is that of the prior about zero.
    """

    quantity: str
    axle: int | None
    load_case: str | None
    unit: float
    sd: float


def unknowns_of(vehicle: Vehicle, carried_N: Mapping[str, np.ndarray]) -> list[Unknown]:
    """Unknowns of all suspensions in the load cases of the records, `carried_N` (na,) of each."""
    found = []
    for i, axle in enumerate(vehicle.axles):
        air = axle.suspension == "air"
        first = next(iter(carried_N.values()))[i] / _STATIC_M[air]
        cases: Sequence[str | None] = list(carried_N) if axle.load_dependent else [None]
        for case in cases:
            size = first if case is None else carried_N[case][i] / _STATIC_M[air]
            found.append(Unknown(STIFFNESS, i, case, float(size), _WIDE))
        found.append(Unknown(DAMPING, i, None, FIRST_DAMPING, _WIDE))
        slope, curve = _SPRING_SD[air]
        for quantity, sd in ((FRICTION, _SD[FRICTION]), (ASYMMETRY, _SD[ASYMMETRY]), (SATURATION, _SD[SATURATION]),
                             (SOFTNESS, _SD[SOFTNESS]), (SLOPE, slope), (CURVE, curve), (STOP, _SD[STOP])):  # fmt: skip
            if _has(axle, quantity):
                found.append(Unknown(quantity, i, None, 1.0, sd))
    if any(u.quantity == FRICTION for u in found):
        found.append(Unknown(SLIP, None, None, SLIP_M, _SLIP_SD))
    return found


def _has(axle: Axle, quantity: str) -> bool:
    if quantity == STOP:
        return axle.has_stops
    if axle.suspension_law is None:
        return True
    elements = law_elements(axle.suspension_law)
    if elements & _DECLARED_CURVES:
        return True
    return any(e in elements for e in _ELEMENT_OF[quantity])


@dataclass(frozen=True)
class Shapes:
    """Nonlinear numbers of all axles: `saturation` [s/m] and `delay` [s] (na,), and the `slip` length [m]."""

    saturation: np.ndarray
    delay: np.ndarray
    slip: float

    def same(self, other: Shapes) -> bool:
        """Whether no number differs."""
        equal = np.array_equal(self.saturation, other.saturation) and np.array_equal(self.delay, other.delay)
        return equal and self.slip == other.slip


def friction_state(deflection: np.ndarray, slip_m: float) -> np.ndarray:
    """phi (n,) of Dahl's friction along a path of deflections (n,) [m], from no force on.

    Between samples phi slides towards the sign of the step: phi_n = a_n phi_(n-1) + (1 - a_n) sgn(dq_n),
    a_n = exp(-|dq_n| / z). The recursion is solved by doubling.
    """
    step = np.diff(deflection, prepend=deflection[:1])
    left = np.exp(-np.abs(step) / slip_m)
    state = np.sign(step) * (1.0 - left)
    reach = 1
    while reach < state.size and left[reach:].max() > 1e-9:
        state[reach:] = state[reach:] + left[reach:] * state[:-reach]
        left[reach:] = left[reach:] * left[:-reach]
        reach *= 2
    return np.asarray(state)


def damper_shape(rate: np.ndarray | float, saturation: float) -> np.ndarray:
    """s(|v|) sgn(v) V / s(V) [m/s] of rates [m/s]; s = v / (1 + kappa v), and v (1 - kappa v) of a progressive one."""

    def factor(speed: np.ndarray | float) -> np.ndarray | float:
        bent = 1.0 + abs(saturation) * speed
        return 1.0 / bent if saturation > 0.0 else bent

    return np.asarray(rate * factor(np.abs(rate)) / factor(REFERENCE_RATE_M_S))


def delayed(rate: np.ndarray, delay_s: float, step_s: float) -> np.ndarray:
    """Rate (n,) behind a first-order lag."""
    if delay_s == 0.0:
        return rate
    omega = 2.0 * np.pi * np.fft.rfftfreq(rate.size, step_s)
    return np.asarray(np.fft.irfft(np.fft.rfft(rate) / (1.0 + 1j * omega * delay_s), rate.size))


def stop_ramp(axle: Axle, deflection: np.ndarray) -> np.ndarray:
    """How far (n,) a suspension is beyond its declared travels [m], + = too long."""
    beyond = np.zeros_like(deflection)
    if axle.rebound_travel_m is not None:
        beyond = beyond + np.maximum(deflection - axle.rebound_travel_m, 0.0)
    if axle.jounce_travel_m is not None:
        beyond = beyond - np.maximum(-deflection - axle.jounce_travel_m, 0.0)
    return beyond
