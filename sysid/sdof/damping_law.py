"""Which damping a record shows, viscous, dry, quadratic or a mixture, and how much of each, by fits to the readings."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sysid.sdof.decay import PreparedRecord
from sysid.sdof.decay_modes import correlated_covariance
from sysid.sdof.decay_window import DecayWindow, decay_window, window_from_release
from sysid.sdof.drop_results import DampingLaw, DampingTerm
from sysid.sdof.mixture_fit import (
    LEVEL,
    OF_TERM,
    OMEGA,
    STIFFENING,
    MixtureFit,
    fit_mixture,
    price_of_leaving,
    without_others,
)
from sysid.sdof.whitening import autoregression

TERMS: tuple[DampingTerm, ...] = ("viscous", "friction", "quadratic")
_SMALLEST_SHARE = 0.03  # of the amplitude lost: a term below that is no part of the kind
_STIFFENING_SWINGS = 6  # the fewest that tell a nonlinear spring from a damper
_POOR_NOISE, _POOR_SHARE = 3.0, 0.04
_HOPELESSLY_POOR = 1.5  # of what is poor: no other start of the fullest mixture mends that
_STIFFENING_EVIDENCE = 20.0  # of the information criterion, before a spring counts as nonlinear
_HOPELESS = 500.0  # of the sum of squares over the variance, far beyond what curvature can make of it
_HELD, _HELD_NOISE = 0.8, 1.2
_NOT_ONE_MASS = "the motion is not that of one mass with viscous, dry or quadratic damping"


def fit_damping_law(record: PreparedRecord, *, from_release: bool = False) -> DampingLaw:
    """Fit one mass with viscous, dry and quadratic damping to the free motion and choose the terms that it shows.

    The mixtures of the three terms are fitted by least squares, from the first extremum used to a quarter period after
    the last one. So the time in which the mass sticks has little weight. Mixtures that a Wald test of the full mixture
    excludes are not fitted. They are compared by the Bayesian information criterion of residuals whitened by an
    autoregression of second order, taken from the fullest mixture. A term that explains less than 3 % of the amplitude
    lost is not considered. Standard deviations allow for what correlation is left. A spring that stiffens with the
    amplitude is added where the criterion demands it.

    Parameters
    ----------
    record
        From `prepare_record`.
    from_release
        Whether the motion is free from the release on, as of a body that is let go: then the swing before the first
        turning point counts, unless the readings contradict it.

    Returns
    -------
    DampingLaw
        `usable` False with a note where there are too few swings or no mixture can be fitted.
    """
    window, start = _started(record, from_release)
    if isinstance(start, str):
        return _unusable(start)
    whitener = autoregression(start.residual, window.first_of_run)
    full = fit_mixture(window, TERMS, whitener, [start.parameters]) or start
    curved = False
    if window.swings.size >= _STIFFENING_SWINGS:
        stiffening = fit_mixture(window, TERMS, whitener, [full.parameters], stiffening=True)
        if stiffening is not None and stiffening.criterion < full.criterion - _STIFFENING_EVIDENCE:
            full, curved = stiffening, True
    noise = record.release.noise_sd if record.release is not None else 0.0
    poor = max(_POOR_NOISE * noise, _POOR_SHARE * window.amplitude)
    if _rms(full) > _HOPELESSLY_POOR * poor:
        return _unusable(_NOT_ONE_MASS)
    fits = {TERMS: full}

    def add(terms: tuple[DampingTerm, ...], like: MixtureFit) -> None:
        starts = [without_others(like, terms), _moved(window, like.parameters, terms), like.parameters]
        if (fit := fit_mixture(window, terms, whitener, starts, stiffening=curved)) is not None:
            fits[terms] = fit

    for terms in _mixtures():
        parent = min((f for t, f in fits.items() if set(terms) < set(t)), key=lambda f: price_of_leaving(f, terms))
        if price_of_leaving(full, terms) < _HOPELESS and price_of_leaving(parent, terms) < _HOPELESS:
            add(terms, parent)
    # A mixture that does worse than a part of it has stopped too early.
    least = min(fits.values(), key=lambda f: float(np.sum(f.whitened**2)))
    if least is not full:
        add(TERMS, least)
    rivals = [f for f in fits.values() if _shares(window, f).min() >= _SMALLEST_SHARE] or [full]
    best = min(rivals, key=lambda f: f.criterion)
    if _with_viscous(best.terms) not in fits:
        add(_with_viscous(best.terms), best)
    if _rms(best) > poor:
        return _unusable(_NOT_ONE_MASS)
    return _law(record, window, best, rivals, fits)


def _started(record: PreparedRecord, from_release: bool) -> tuple[DecayWindow, MixtureFit | str]:
    """The part to fit and the first fit of the fullest mixture, without whitening; or why there is none."""
    later = decay_window(record)
    window = (window_from_release(record) or later) if from_release else later
    if isinstance(window, str):
        return None, window  # type: ignore[return-value]
    start = _first_fit(window, record)
    if from_release and not isinstance(later, str) and (start is None or _held(start, record)):
        # Something still touched the body after the release: what comes after the first turn is free.
        alternative = _first_fit(later, record)
        if alternative is not None and (start is None or _rms(alternative) < _HELD * _rms(start)):
            window, start = later, alternative
    return window, start or "no damped oscillation can be fitted to the readings"


def _first_fit(window: DecayWindow, record: PreparedRecord) -> MixtureFit | None:
    """The fullest mixture from one start or, where that leaves far more than the noise, from others."""
    fit = fit_mixture(window, TERMS, np.zeros(0), [_first_start(window)])
    if fit is not None and not _held(fit, record):
        return fit
    starts = [_first_start(window, factor, loss) for factor in (0.85, 1.0, 1.15) for loss in (0.15, 0.4)]
    return fit_mixture(window, TERMS, np.zeros(0), ([] if fit is None else [fit.parameters]) + starts, most=3)


def _first_start(window: DecayWindow, factor: float = 1.0, loss: float | None = None) -> np.ndarray:
    """Start values in which viscous damping takes the share `loss` of the amplitude per swing, as read if None."""
    start = window.start.copy()
    start[OMEGA] *= factor
    if loss is None:
        mean = float(np.mean(-np.diff(window.swings))) if window.swings.size > 1 else 0.1 * window.amplitude
        loss = float(np.clip(mean / window.swings.mean(), 0.01, 1.0))
    start[4] = loss / np.pi * start[OMEGA]
    return start


def _with_viscous(terms: tuple[DampingTerm, ...]) -> tuple[DampingTerm, ...]:
    return tuple(t for t in TERMS if t in terms or t == "viscous")


def _rms(fit: MixtureFit) -> float:
    return float(np.sqrt(np.mean(fit.residual**2)))


def _held(fit: MixtureFit, record: PreparedRecord) -> bool:
    """Whether a fit leaves clearly more than the noise."""
    return record.release is not None and _rms(fit) > _HELD_NOISE * record.release.noise_sd


def _mixtures() -> list[tuple[DampingTerm, ...]]:
    return [terms for count in (2, 1) for terms in combinations(TERMS, count)]


def _loss_terms(window: DecayWindow, parameters: np.ndarray) -> np.ndarray:
    """Amplitude lost per swing by each term, averaged over the swings: pi zeta X, 2 f and 4/3 q X^2 (3,) [m]."""
    x = window.swings
    omega, beta, friction, quadratic = parameters[[OMEGA, 4, 5, 6]]
    return np.array(
        [np.pi * beta / omega * x.mean(), 2.0 * min(friction, x.mean()), 4.0 / 3.0 * quadratic * (x**2).mean()]
    )


def _shares(window: DecayWindow, fit: MixtureFit) -> np.ndarray:
    """Share of each term of a fit in the amplitude lost."""
    loss = _loss_terms(window, fit.parameters)
    return np.array([loss[TERMS.index(t)] for t in fit.terms]) / max(float(loss.sum()), 1e-300)


def _moved(window: DecayWindow, parameters: np.ndarray, terms: tuple[DampingTerm, ...]) -> np.ndarray:
    """Parameters in which `terms` share the losses of all."""
    total = float(_loss_terms(window, parameters).sum())
    moved = parameters.copy()
    for term in TERMS:
        index = OF_TERM[term]
        if term not in terms:
            moved[index] = 0.0
            continue
        unit = parameters.copy()
        unit[4:7] = 0.0
        # A small unit keeps the friction below the cap of `_loss_terms`.
        unit[index] = 1e-6
        per_unit = float(_loss_terms(window, unit).sum()) / 1e-6
        by_term = float(_loss_terms(window, parameters)[TERMS.index(term)])
        kept = sum(float(_loss_terms(window, parameters)[TERMS.index(t)]) for t in terms)
        moved[index] = (by_term + (total - kept) / len(terms)) / per_unit
    return moved


def _law(
    record: PreparedRecord,
    window: DecayWindow,
    best: MixtureFit,
    rivals: list[MixtureFit],
    fits: dict[tuple[DampingTerm, ...], MixtureFit],
) -> DampingLaw:
    """The chosen mixture; the viscous part of a mixture without it comes from the one that has it besides."""
    runner_up = min((f for f in rivals if f is not best), key=lambda f: f.criterion, default=None)
    full = best
    if "viscous" not in best.terms:
        full = fits.get(_with_viscous(best.terms), best)
    values, covariance = _quantities(full)
    if full is not best:
        # What the record shows comes from the fit without the term it does not show.
        shown, shown_covariance = _quantities(best)
        others = [0, 2, 3]
        values[others] = shown[others]
        covariance[np.ix_(others, others)] = shown_covariance[np.ix_(others, others)]
        covariance[1, others] = covariance[others, 1] = 0.0
    covariance = covariance + np.diag(_spread(best, rivals))
    noise = record.release.noise_sd if record.release is not None else float("nan")
    rms = float(np.sqrt(np.mean(best.residual**2)))
    loss = np.array([_loss_terms(window, best.parameters)[TERMS.index(t)] if t in best.terms else 0.0 for t in TERMS])
    return DampingLaw(
        terms=best.terms,
        runner_up=runner_up.terms if runner_up is not None else (),
        evidence=runner_up.criterion - best.criterion if runner_up is not None else float("inf"),
        damped_period=float(values[0]),
        log_decrement=float(values[1]),
        friction_m=float(values[2]),
        quadratic_per_m=float(values[3]),
        covariance=covariance,
        shares=loss / max(float(loss.sum()), 1e-300),
        level=float(best.parameters[LEVEL]),
        stiffening_per_m2=float(best.parameters[STIFFENING]),
        stick_time_s=float(best.motion.stick_s[0]) + window.begin_s,
        window_s=(window.begin_s, window.begin_s + float(window.time[-1])),
        time_s=window.begin_s + window.time,
        model=best.motion.value[0],
        residual_rms=rms,
        noise_ratio=rms / noise if noise > 1e-9 * window.amplitude else float("nan"),
        usable=True,
        note="",
    )


def _spread(best: MixtureFit, rivals: list[MixtureFit]) -> np.ndarray:
    """Variance (4,) of the quantities over the mixtures that have them, weighted by their evidence."""
    weight = np.array([np.exp(-0.5 * min(f.criterion - best.criterion, 1400.0)) for f in rivals])
    values = np.array([_quantities(f)[0] for f in rivals])
    has = np.array([[True, *(t in f.terms for t in TERMS)] for f in rivals])
    of_best = _quantities(best)[0]
    variance = np.zeros(4)
    for i in range(4):
        w = np.where(has[:, i], weight, 0.0)
        if has[rivals.index(best), i]:
            variance[i] = float(np.sum(w * (values[:, i] - of_best[i]) ** 2) / w.sum())
    return variance


def _quantities(fit: MixtureFit) -> tuple[np.ndarray, np.ndarray]:
    """Damped period, viscous decrement, f and q (4,) with their covariance (4, 4)."""
    omega, beta, friction, quadratic = fit.parameters[[OMEGA, 4, 5, 6]]
    damped = np.sqrt(omega**2 - beta**2)
    values = np.array([2.0 * np.pi / damped, 2.0 * np.pi * beta / damped, friction, quadratic])
    slope = np.zeros((4, 8))
    slope[0, OMEGA], slope[0, 4] = -2.0 * np.pi * omega / damped**3, 2.0 * np.pi * beta / damped**3
    slope[1, OMEGA], slope[1, 4] = -2.0 * np.pi * beta * omega / damped**3, 2.0 * np.pi * omega**2 / damped**3
    slope[2, 5] = slope[3, 6] = 1.0
    of_free = correlated_covariance(fit.jacobian, fit.whitened)
    return values, slope[:, fit.free] @ of_free @ slope[:, fit.free].T


def _unusable(note: str) -> DampingLaw:
    nan, empty = float("nan"), np.zeros(0)
    return DampingLaw(
        (),
        (),
        nan,
        nan,
        nan,
        nan,
        nan,
        np.full((4, 4), nan),
        np.full(3, nan),
        nan,
        nan,
        nan,
        (nan, nan),
        empty,
        empty,
        nan,
        nan,
        False,
        note,
    )
