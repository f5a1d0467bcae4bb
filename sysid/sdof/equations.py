"""Equations (1)-(3) of the reference paper, their exact form, and the inversion with the tire in series.

Everything here is per axle (both sides together), in SI units, elementwise on arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

STIFFNESS_RATIO_LIMIT = 0.4  # k/kt above which the correction amplifies errors of the reading and of kt beyond use


def log_decrement(amplitude: Any, next_amplitude: Any) -> Any:
    """Logarithmic decrement of two successive amplitudes of equal sign.

    delta = ln(u_i / u_(i+1)).  `amplitude`, `next_amplitude` in one unit, broadcastable.  Source: paper, equation (3).
    """
    return np.log(np.asarray(amplitude, float) / np.asarray(next_amplitude, float))


def damping_ratio_from_decrement(decrement: Any) -> Any:
    """Damping ratio from the logarithmic decrement per full cycle: zeta = delta / sqrt(4 pi^2 + delta^2)."""
    decrement = np.asarray(decrement, float)
    return decrement / np.sqrt(4.0 * np.pi**2 + decrement**2)


def decrement_from_damping_ratio(damping_ratio: Any) -> Any:
    """Logarithmic decrement per full cycle from the damping ratio: delta = 2 pi zeta / sqrt(1 - zeta^2), zeta < 1."""
    damping_ratio = np.asarray(damping_ratio, float)
    return 2.0 * np.pi * damping_ratio / np.sqrt(1.0 - damping_ratio**2)


def directive_damping(decrement: Any) -> Any:
    """Damping D = ln(A1/A2) / (2 pi) as EU 96/53/EC Annex II and VSB 11 define it (not the damping ratio zeta)."""
    return np.asarray(decrement, float) / (2.0 * np.pi)


def paper_stiffness(damped_period: Any, mass: Any) -> Any:
    """Suspension stiffness [N/m] as the paper reads it from the damped period.

    k_i = 4 pi^2 m_bi / tau_d^2 with the damped period tau_d [s] and the tributary mass m_bi [kg].  The factor
    (1 - zeta^2) and the tire in series are left out, as in the paper.  Source: paper, equation (1).
    """
    return 4.0 * np.pi**2 / np.asarray(damped_period, float) ** 2 * np.asarray(mass, float)


def paper_damping(damped_period: Any, decrement: Any, mass: Any) -> Any:
    """Suspension damping coefficient [N s/m] as the paper reads it from the decrement.

    c_i = 2 delta / sqrt(4 pi^2 + delta^2) sqrt(k_i m_bi) with k_i of `paper_stiffness`, the logarithmic decrement delta
    and the tributary mass m_bi [kg].  Source: paper, equation (2).
    """
    stiffness = paper_stiffness(damped_period, mass)
    return 2.0 * damping_ratio_from_decrement(decrement) * np.sqrt(stiffness * np.asarray(mass, float))


def exact_stiffness(damped_period: Any, decrement: Any, mass: Any) -> Any:
    """Stiffness [N/m] of a viscously damped single mass: k = m (4 pi^2 + delta^2) / tau_d^2."""
    return np.asarray(mass, float) * (4.0 * np.pi**2 + np.asarray(decrement, float) ** 2) / np.square(damped_period)


def exact_damping(damped_period: Any, decrement: Any, mass: Any) -> Any:
    """Damping coefficient [N s/m] of a viscously damped single mass: c = 2 m delta / tau_d."""
    return 2.0 * np.asarray(mass, float) * np.asarray(decrement, float) / np.asarray(damped_period, float)


def series_stiffness(equivalent_stiffness: Any, tire_stiffness: Any) -> Any:
    """Low-order removal of the tire in series from a stiffness: k_s = k_eq kt / (kt - k_eq), all in N/m."""
    equivalent_stiffness, tire_stiffness = np.asarray(equivalent_stiffness, float), np.asarray(tire_stiffness, float)
    return equivalent_stiffness * tire_stiffness / (tire_stiffness - equivalent_stiffness)


def series_damping(equivalent_damping: Any, stiffness: Any, tire_stiffness: Any, tire_damping: Any = 0.0) -> Any:
    """Low-order removal of the tire in series from a damping coefficient.

    c_s = (c_eq - ct (k_s/(k_s+kt))^2) ((k_s+kt)/kt)^2 with the suspension stiffness k_s, the tire stiffness kt [N/m],
    the damping seen by the body c_eq and the tire damping ct [N s/m].  The unsprung mass is neglected here and not in
    `corrected_damping`.
    """
    stiffness, tire_stiffness = np.asarray(stiffness, float), np.asarray(tire_stiffness, float)
    total = stiffness + tire_stiffness
    tire_share = np.asarray(tire_damping, float) * (stiffness / total) ** 2
    return (np.asarray(equivalent_damping, float) - tire_share) * (total / tire_stiffness) ** 2


def invert_quarter_car(
    eigenvalue: Any, mass: Any, unsprung_mass: Any, tire_stiffness: Any, tire_damping: Any = 0.0
) -> tuple[Any, Any]:
    """Suspension stiffness and damping whose quarter car has the given complex body-mode eigenvalue, exactly.

    Sprung mass m on k, c on unsprung mass m_u on tire kt, ct.  With P = m_u s^2 + ct s + kt the characteristic equation
    (m s^2 + Z)(P + Z) = Z^2 is linear in the dynamic stiffness Z = k + c s, so

        Z = -m s^2 P / (m s^2 + P),   c = Im Z / Im s,   k = Re Z - c Re s.

    For m_u = ct = 0 and light damping this is `series_stiffness` and `series_damping`.

    Parameters
    ----------
    eigenvalue
        s = -delta/tau_d + i 2 pi/tau_d [1/s], non-zero imaginary part.
    mass, unsprung_mass
        kg.
    tire_stiffness, tire_damping
        N/m, N s/m.

    Returns
    -------
    tuple
        Stiffness [N/m], damping [N s/m].  Where the measured stiffness is not below the tire's no positive suspension
        stiffness exists and the numbers come out negative; callers check that.
    """
    s = np.asarray(eigenvalue, complex)
    inertia = np.asarray(mass, float) * s**2
    tire = np.asarray(unsprung_mass, float) * s**2 + np.asarray(tire_damping, float) * s + tire_stiffness
    dynamic_stiffness = -inertia * tire / (inertia + tire)
    damping = dynamic_stiffness.imag / s.imag
    return dynamic_stiffness.real - damping * s.real, damping


def eigenvalue_of_quarter_car(
    stiffness: float, damping: float, mass: float, unsprung_mass: float, tire_stiffness: float, tire_damping: float
) -> complex:
    """Complex body-mode eigenvalue s [1/s] of a quarter car, the slowest that oscillates, NaN where none does.

    (m s^2 + Z)(mu s^2 + ct s + kt + Z) = Z^2 with Z = k + c s: the inverse of `invert_quarter_car`.  Arguments in N/m,
    N s/m and kg.
    """
    suspension = np.array([damping, stiffness])
    body = np.array([mass, damping, stiffness])
    wheel = np.array([unsprung_mass, tire_damping + damping, tire_stiffness + stiffness])
    roots = np.roots(np.polysub(np.polymul(body, wheel), np.polymul(suspension, suspension)))
    swings = roots[roots.imag > 1e-9 * np.abs(roots)]
    return complex(swings[np.argmin(swings.imag)]) if swings.size else complex(np.nan, np.nan)


def eigenvalue_from_decay(damped_period: Any, decrement: Any) -> Any:
    """Complex eigenvalue s = (-delta + 2 pi i) / tau_d [1/s] of a decaying oscillation."""
    return (-np.asarray(decrement, float) + 2j * np.pi) / np.asarray(damped_period, float)


def corrected_stiffness(
    damped_period: Any, decrement: Any, mass: Any, unsprung_mass: Any, tire_stiffness: Any, tire_damping: Any = 0.0
) -> Any:
    """Suspension stiffness [N/m] with the tire in series, its damping and the unsprung mass taken out exactly.

    See `invert_quarter_car`; exact for a single linear axle, meant for k/kt <= 0.4.
    """
    eigenvalue = eigenvalue_from_decay(damped_period, decrement)
    return invert_quarter_car(eigenvalue, mass, unsprung_mass, tire_stiffness, tire_damping)[0]


def corrected_damping(
    damped_period: Any, decrement: Any, mass: Any, unsprung_mass: Any, tire_stiffness: Any, tire_damping: Any = 0.0
) -> Any:
    """Suspension damping [N s/m] with the tire in series, its damping and the unsprung mass taken out exactly.

    See `invert_quarter_car`; exact for a single linear axle, meant for k/kt <= 0.4.
    """
    eigenvalue = eigenvalue_from_decay(damped_period, decrement)
    return invert_quarter_car(eigenvalue, mass, unsprung_mass, tire_stiffness, tire_damping)[1]


def propagate(
    function: Callable[[np.ndarray], np.ndarray],
    values: np.ndarray,
    covariance: np.ndarray,
    relative_step: float = 1e-5,
) -> tuple[np.ndarray, np.ndarray]:
    """Values of a function of uncertain numbers and their covariance to first order (delta method).

    cov(f) = J cov(x) J^T with J from central differences.

    Parameters
    ----------
    function
        Maps (n,) to (m,).
    values, covariance
        (n,) and (n, n).
    relative_step
        Step of the differences relative to each value (absolute where the value is zero).

    Returns
    -------
    tuple
        f(values) (m,) and its covariance (m, m).
    """
    values = np.asarray(values, float)
    columns = []
    for index, value in enumerate(values):
        step = np.zeros_like(values)
        step[index] = relative_step * (abs(value) or 1.0)
        columns.append((np.asarray(function(values + step)) - np.asarray(function(values - step))) / (2 * step[index]))
    jacobian = np.stack(columns, axis=-1)
    return np.asarray(function(values), float), jacobian @ covariance @ jacobian.T
