"""Stiffness and damping estimates of one axle from period and decrement, with their standard deviations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.sdof.drop_results import DampingLaw, DropEstimate, DropMethod
from sysid.sdof.equations import (
    STIFFNESS_RATIO_LIMIT,
    corrected_damping,
    corrected_stiffness,
    paper_damping,
    paper_stiffness,
    propagate,
)
from sysid.sdof.settings import DropSettings


@dataclass(frozen=True)
class AxleOnTire:
    """One axle as the single-axle equations see it: tributary and unsprung mass [kg], tire [N/m, N s/m]."""

    axle: int
    load_case: str
    mass: float
    unsprung_mass: float
    tire_stiffness: float
    tire_damping: float


@dataclass(frozen=True)
class Inversion:
    """Stiffness and damping with the covariances (2, 2) from the reading and from the declared quantities."""

    stiffness: float
    damping: float
    reading_covariance: np.ndarray
    declared_covariance: np.ndarray


def invert(
    method: DropMethod,
    axle: AxleOnTire,
    settings: DropSettings,
    damped_period: float,
    decrement: float,
    covariance: np.ndarray,
) -> Inversion:
    """Stiffness and damping by equations (1)-(2) or by the exact quarter-car inversion, uncertainties to first order.

    Parameters
    ----------
    method
        ``paper`` neglects the tire; ``corrected`` and ``free_decay`` remove its effect.
    axle, settings
        Declared quantities and their tolerances.
    damped_period, decrement, covariance
        tau_d [s], delta [-] and their covariance (2, 2).
    """
    value, from_reading, from_declared = _uncertain(
        _equations(method), axle, settings, damped_period, decrement, covariance
    )
    return Inversion(float(value[0]), float(value[1]), from_reading, from_declared)


def forces_per_unit(
    method: DropMethod,
    axle: AxleOnTire,
    settings: DropSettings,
    damped_period: float,
    decrement: float,
    covariance: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F/f = k (1 + k/kt) [N/m] and Q/q = m (1 + k/kt)^2 [kg] (2,), with covariances (2, 2); k/kt = 0 for ``paper``.

    Arguments and covariances (from the reading, from the declared quantities) are those of `invert`.
    """
    equations = _equations(method)

    def per_unit(read: np.ndarray, given: np.ndarray) -> np.ndarray:
        stiffness = float(equations(read, given)[0])
        ratio = 0.0 if method == "paper" else stiffness / given[2]
        return np.array([stiffness * (1.0 + ratio), given[0] * (1.0 + ratio) ** 2])

    return _uncertain(per_unit, axle, settings, damped_period, decrement, covariance)


_Equations = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _equations(method: DropMethod) -> _Equations:
    """Stiffness and damping (2,) from period and decrement (2,) and masses and tire (4,)."""

    def paper(read: np.ndarray, given: np.ndarray) -> np.ndarray:
        return np.array([paper_stiffness(read[0], given[0]), paper_damping(read[0], read[1], given[0])])

    def exact(read: np.ndarray, given: np.ndarray) -> np.ndarray:
        return np.array([corrected_stiffness(*read, *given), corrected_damping(*read, *given)])

    return paper if method == "paper" else exact


def _uncertain(
    function: _Equations,
    axle: AxleOnTire,
    settings: DropSettings,
    damped_period: float,
    decrement: float,
    covariance: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (2,) of a function of reading and declared quantities, with the covariances (2, 2) from either."""
    declared = np.array([axle.mass, axle.unsprung_mass, axle.tire_stiffness, axle.tire_damping])
    tolerance = np.array(
        [
            settings.tributary_mass_tolerance,
            settings.unsprung_mass_tolerance,
            settings.tire_stiffness_tolerance,
            settings.tire_damping_tolerance,
        ]
    )
    reading = np.array([damped_period, decrement])
    value, from_reading = propagate(lambda read: function(read, declared), reading, covariance)
    _, from_declared = propagate(lambda given: function(reading, given), declared, np.diag((declared * tolerance) ** 2))
    return value, from_reading, from_declared


def estimate(
    method: DropMethod,
    axle: AxleOnTire,
    settings: DropSettings,
    file: str | None,
    damped_period: float,
    decrement: float,
    covariance: np.ndarray,
    note: str = "",
) -> DropEstimate:
    """One `DropEstimate`; unusable with a reason where the numbers have no physical meaning."""
    result = invert(method, axle, settings, damped_period, decrement, covariance)
    notes = [note] if note else []
    if method != "paper":
        if not 0.0 < result.stiffness < np.inf:
            notes.append(
                "the measured stiffness is not below the tire's, so no suspension stiffness can be told from it"
            )
            return unusable(method, axle, file, "; ".join(notes), damped_period, decrement)
        if result.damping <= 0.0:
            notes.append(
                "the declared tire damping alone explains more than the measured decrement, "
                "so no suspension damping can be told from it"
            )
            return unusable(method, axle, file, "; ".join(notes), damped_period, decrement)
        ratio = result.stiffness / axle.tire_stiffness
        if ratio > STIFFNESS_RATIO_LIMIT:
            notes.append(f"k/kt = {ratio:.2f} is above {STIFFNESS_RATIO_LIMIT:g}, where the correction is not reliable")
    sd = np.sqrt(np.diagonal(result.reading_covariance + result.declared_covariance))
    return DropEstimate(
        axle=axle.axle,
        load_case=axle.load_case,
        file=file,
        method=method,
        stiffness=result.stiffness,
        stiffness_sd=float(sd[0]),
        damping=result.damping,
        damping_sd=float(sd[1]),
        damped_period=damped_period,
        log_decrement=decrement,
        usable=True,
        note="; ".join(notes),
    )


def estimate_by_law(
    method: DropMethod, axle: AxleOnTire, settings: DropSettings, file: str, law: DampingLaw, note: str
) -> DropEstimate:
    """The viscous part of a damping law through the equations of `method`, dry friction and quadratic damping apart.

    F = f k (1 + k/kt) and Q = q m (1 + k/kt)^2, with f [m] and q [1/m] of the law, and k/kt = 0 for the paper's method.
    The reason: while the suspension sticks, the tire deforms. By the energy at two successive turning points, the
    amplitude then falls by 2 F / (k (1 + k/kt)) per swing. A force that is small against that of the spring takes the
    energy integral Q |s'| s'^2 dt from a system with the mass m (1 + k/kt)^2 in the coordinate s of the suspension. A
    viscous part that the tire's own damping explains is zero.
    """
    notes = [note] if note else []
    covariance = law.covariance[:2, :2]
    result = invert(method, axle, settings, law.damped_period, law.log_decrement, covariance)
    if not 0.0 < result.stiffness < np.inf:
        notes.append("the measured stiffness is not below the tire's, so no suspension stiffness can be told from it")
        return unusable(method, axle, file, "; ".join(notes), law.damped_period, law.log_decrement)
    sd = np.sqrt(np.diagonal(result.reading_covariance + result.declared_covariance))
    if "viscous" not in law.terms:
        notes.append("viscous damping cannot be told from zero")
    ratio = 0.0 if method == "paper" else result.stiffness / axle.tire_stiffness
    if ratio > STIFFNESS_RATIO_LIMIT:
        notes.append(f"k/kt = {ratio:.2f} is above {STIFFNESS_RATIO_LIMIT:g}, where the correction is not reliable")
    per_unit, *parts = forces_per_unit(method, axle, settings, law.damped_period, law.log_decrement, covariance)
    of_law = np.array([law.friction_m, law.quadratic_per_m])
    force = per_unit * of_law
    force_sd = np.sqrt(np.diagonal(law.covariance)[2:] * per_unit**2 + np.diagonal(sum(parts)) * of_law**2)
    absent = [term not in law.terms for term in ("friction", "quadratic")]
    force[absent] = force_sd[absent] = np.nan
    return DropEstimate(
        axle=axle.axle,
        load_case=axle.load_case,
        file=file,
        method=method,
        stiffness=result.stiffness,
        stiffness_sd=float(sd[0]),
        damping=max(result.damping, 0.0),
        damping_sd=float(sd[1]),
        damped_period=law.damped_period,
        log_decrement=law.log_decrement,
        usable=True,
        note="; ".join(notes),
        damping_kind=law.kind,
        friction_force=float(force[0]),
        friction_force_sd=float(force_sd[0]),
        quadratic_damping=float(force[1]),
        quadratic_damping_sd=float(force_sd[1]),
    )


def unusable(
    method: DropMethod,
    axle: AxleOnTire,
    file: str | None,
    note: str,
    damped_period: float = float("nan"),
    decrement: float = float("nan"),
) -> DropEstimate:
    """An estimate without numbers."""
    nan = float("nan")
    return DropEstimate(
        axle.axle, axle.load_case, file, method, nan, nan, nan, nan, damped_period, decrement, False, note
    )
