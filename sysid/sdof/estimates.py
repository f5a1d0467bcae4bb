"""Stiffness and damping estimates of one axle from period and decrement, with their standard deviations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.sdof.drop_results import DecayFit, DropEstimate, DropMethod
from sysid.sdof.equations import (
    STIFFNESS_RATIO_LIMIT,
    corrected_damping,
    corrected_stiffness,
    paper_damping,
    paper_stiffness,
    propagate,
)
from sysid.sdof.settings import DropSettings

# Relative standard deviations above which a number says too little; damping is also told within 1 % of the critical.
_STIFFNESS_TOLD, _DAMPING_TOLD, _OF_CRITICAL = 0.10, 1.0 / 3.0, 0.01
_SURE, _ABSENT = 0.9, 0.1  # probabilities of an element that is there, and of one that is not
_SEEN = 0.1  # strength of a further mode that is worth a word
_SWING_M = 0.03  # at which a curved spring is described


@dataclass(frozen=True)
class AxleOnTire:
    """One axle as the single-axle equations see it: masses [kg], tire [N/m, N s/m], and if it has leaves."""

    axle: int
    load_case: str
    mass: float
    unsprung_mass: float
    tire_stiffness: float
    tire_damping: float
    leaf: bool = False


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


def of_fit(fit: DecayFit, axle: AxleOnTire, file: str | None, note: str = "") -> DropEstimate:
    """The row of a fitted quarter car; not usable, with the reason, where k or c cannot be told from the record."""
    sd = np.sqrt(np.diagonal(fit.covariance))
    critical = 2.0 * float(np.sqrt(fit.stiffness * axle.mass))
    kind = damping_kind(fit)
    (k, c), (k_sd, c_sd) = 1e-3 * np.array([fit.stiffness, fit.damping]), 1e-3 * sd
    told = f"k {k:.0f} ± {k_sd:.0f} kN/m, c {c:.1f} ± {c_sd:.1f} kN s/m"
    shown = _shown(fit)
    notes = [*shown, *([note] if note else [])]
    period = (fit.damped_period, fit.log_decrement)
    beside = f" ({', '.join(shown)})" if shown else ""
    if not sd[0] <= _STIFFNESS_TOLD * fit.stiffness:
        why = f"the stiffness cannot be told from this record{beside}: {told}"
    elif not sd[1] <= max(_DAMPING_TOLD * fit.damping, _OF_CRITICAL * critical):
        why = f"the damping cannot be told from this record{beside}: {told}"
    else:
        why = ""
    if why:
        of_none = unusable("free_decay", axle, file, "; ".join([why, *([note] if note else [])]), *period)
        return replace(of_none, damping_kind=kind)
    ratio = fit.stiffness / axle.tire_stiffness
    if ratio > STIFFNESS_RATIO_LIMIT:
        notes.append(f"k/kt = {ratio:.2f} is above {STIFFNESS_RATIO_LIMIT:g}, where the tire decides")
    rubs = fit.probability["friction"] > 0.5
    bends = fit.probability["quadratic"] > 0.5
    nothing = (float("nan"), float("nan"))
    friction, quadratic = fit.friction_force if rubs else nothing, fit.quadratic_damping if bends else nothing
    return DropEstimate(
        axle=axle.axle,
        load_case=axle.load_case,
        file=file,
        method="free_decay",
        stiffness=fit.stiffness,
        stiffness_sd=float(sd[0]),
        damping=fit.damping,
        damping_sd=float(sd[1]),
        damped_period=fit.damped_period,
        log_decrement=fit.log_decrement,
        usable=True,
        note="; ".join(notes),
        damping_kind=kind,
        friction_force=friction[0],
        friction_force_sd=friction[1],
        quadratic_damping=quadratic[0],
        quadratic_damping_sd=quadratic[1],
    )


def damping_kind(fit: DecayFit) -> str:
    """Which damping a fitted record shows, ``unknown`` where the models do not agree on it."""
    if any(_ABSENT < fit.probability[e] < _SURE for e in ("friction", "quadratic")):
        return "unknown"
    sd = float(np.sqrt(fit.covariance[1, 1]))
    terms = [
        name
        for name, there in (
            ("viscous", fit.damping > 2.0 * sd),
            ("friction", fit.probability["friction"] >= _SURE),
            ("quadratic", fit.probability["quadratic"] >= _SURE and fit.quadratic_damping[0] > 0.0),
        )
        if there
    ]
    return " + ".join(terms) or "unknown"


def _shown(fit: DecayFit) -> list[str]:
    """What the record shows beyond a linear quarter car, in words."""
    sure = {e for e, p in fit.probability.items() if p >= _SURE}
    words = []
    if "friction" in sure:
        (force, sd), (slip, slip_sd) = fit.friction_force, fit.slip_m
        words.append(
            f"dry friction of {1e-3 * force:.2f} ± {1e-3 * sd:.2f} kN over {1e3 * slip:.1f} ± {1e3 * slip_sd:.1f} mm"
        )
    if "progressive" in sure:
        bend, cubic = fit.bend_per_m[0], fit.cubic_per_m2[0]
        at = [100.0 * (2.0 * bend * y + 3.0 * cubic * y * y) for y in (-_SWING_M, _SWING_M)]
        words.append(f"the spring's rate {at[0]:+.0f} % at {1e3 * _SWING_M:.0f} mm, {at[1]:+.0f} % in rebound")
    if "asymmetric" in sure:
        share = 50.0 * (1.0 - fit.asymmetry[0])
        words.append(f"{share:.0f} % of the damping in compression, c is the mean of both ways")
    if "quadratic" in sure and fit.quadratic_damping[0] < 0.0:
        words.append("the damper's force grows less than its speed, c is that of slow motion")
    if "mode" in sure and fit.mode_strength > _SEEN:
        words.append(f"a further mode at {fit.mode_hz:.2f} Hz, {100.0 * fit.mode_strength:.0f} % as strong")
    return words


def with_bias(row: DropEstimate, fit: DecayFit) -> DropEstimate:
    """A row from the peaks; its standard deviations hold its difference from the fitted quarter car, which it names."""
    value, sd = np.array([row.stiffness, row.damping]), np.array([row.stiffness_sd, row.damping_sd])
    fitted = np.array([fit.stiffness, fit.damping])
    off = value - fitted
    wide = np.hypot(np.maximum(sd, np.sqrt(np.diagonal(fit.covariance))), off)
    parts = [f"k {100.0 * off[0] / fitted[0]:+.0f} %"]
    if fitted[1] > np.sqrt(fit.covariance[1, 1]):
        parts.append(f"c {100.0 * off[1] / fitted[1]:+.0f} %")
    else:
        parts.append(f"c {1e-3 * off[1]:+.1f} kN s/m")
    said = f"{' and '.join(parts)} against the fitted quarter car"
    return replace(
        row,
        stiffness_sd=float(wide[0]),
        damping_sd=float(wide[1]),
        note="; ".join(part for part in (said, row.note) if part),
        damping_kind=damping_kind(fit),
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
