"""The decay after a drop as a quarter car: most probable stiffness and damping over a small set of models."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from sysid.campaign.units import STANDARD_GRAVITY_M_S2
from sysid.display import Z90
from sysid.sdof.decay import PreparedRecord
from sysid.sdof.decay_models import (
    DECLARED,
    ELEMENTS,
    LOGARITHMIC,
    PLACE,
    UNKNOWNS,
    Elements,
    Priors,
    beside,
    free,
    motion,
    next_to,
)
from sysid.sdof.decay_modes import fit_modes, scan_single_mode
from sysid.sdof.decay_search import Optimum, Readings, search
from sysid.sdof.drop_results import DecayFit
from sysid.sdof.equations import eigenvalue_of_quarter_car, invert_quarter_car
from sysid.sdof.estimates import AxleOnTire
from sysid.sdof.settings import DropSettings
from sysid.sdof.smoothing import high_frequency_noise, local_polynomial

# Priors of what is not declared, as (middle, standard deviation); a logarithmic one as (median, of the logarithm).
_FRICTION_SHARE = 0.06  # of the load, of a positive force: leaf packs have 2 to 10 % (Fancher et al., UMTRI-86-12)
_SLIP = (2e-3, 1.2)  # m: some 0.2 to 20 mm (Fancher et al., SAE 800905, have 1 to 3 mm)
_BEND, _CUBIC = (0.0, 5.0), (0.0, 250.0)  # 1/m, 1/m^2: a gas spring of 0.2 to 0.35 m, twice as stiff at 50 to 60 mm
_ASYMMETRY = (0.0, 0.5)  # of the damper, truck dampers have 0.2 to 0.7
_DAMPING_RATIO, _QUADRATIC_AT_M_S = (0.1, 0.2), 0.3  # and the speed at which a quadratic part is as large
_MODE = ((1.0, 0.4), (0.08, 0.6))  # frequency over that of the body, damping ratio
_DRIFT_M_S = 0.005
_SPREAD_OF_START = {"extension": 0.01, "extension_rate": 0.2, "wheel": 0.01, "wheel_rate": 0.3, "level": 0.02}

#: Odds of every element before the readings; leaf springs rub, other springs less often.
_ODDS = {"friction": 0.5, "progressive": 0.4, "asymmetric": 1.0, "quadratic": 0.4, "mode": 0.1}
_LEAF_RUBS, _NEIGHBOURS_BEAT = 4.0, 0.5
# Modes of one body repel each other: two of one frequency are improbable, and look like damping that depends on the
# amplitude. Mean and least distance in the logarithm of the frequency.
_APART, _CLOSEST = 0.3, 0.005

_LONGEST_PERIODS, _LONGEST_S = 12.0, 6.0
_FEWEST_READINGS = 40
_FINEST_S = 0.004  # between readings: faster logs are averaged
_SECOND_MODE = (0.7, 0.85, 1.2, 1.5)  # frequency over that of the first at which a search of two modes begins
_MODEL_ERROR = 2e-4  # of the amplitude: what the integrator and its derivatives err by
# Of the motion, and of the noise, in the residual: a record of which both are left has no quarter car behind it.
_UNEXPLAINED, _NOISE_RATIO = 0.03, 1.5
_AT_REST = 4.0  # standard deviations of the noise, within which a record is over
_CLOSE = 15.0  # in the logarithm of the odds: models that count
_MOST_ELEMENTS = 4
_LINEAR_LAWS = frozenset({"mode"})


def fit_decay(
    record: PreparedRecord,
    axle: AxleOnTire,
    settings: DropSettings,
    *,
    from_release: bool = False,
    neighbours: bool = False,
    earliest_s: float = -np.inf,
) -> DecayFit | str:
    """Stiffness and damping of a quarter car from the motion after its drop, averaged over models of it.

    The body on spring and damper, the wheel on its tire, as `QuarterCars` has them: alone and with dry friction, a
    curved spring, an asymmetric or quadratic damper, a further mode of the body. The fit begins when the body has come
    down (at the second turning point), in a state that is estimated with the rest, so that it does not matter how the
    wheel left the plank. Declared masses and tires are unknowns with their tolerances. The models are found one element
    at a time from the best one so far, and averaged with their evidence (Laplace's method) and the odds of their
    elements (Hoeting et al. 1999, doi:10.1214/ss/1009212519), so that the standard deviations cover the choice. Where
    the residual is correlated over tau readings, each counts as 1 / tau.

    Parameters
    ----------
    record
        From `prepare_record`.
    axle, settings
        Declared quantities and their tolerances.
    from_release
        Whether a body was let go, which moves freely from its release on.
    neighbours
        Whether other axles carry the body too, which makes further modes likely.
    earliest_s
        The fit does not begin before this time [s].

    Returns
    -------
    DecayFit or str
        Why there is no fit, where there are too few readings.
    """
    prepared = _prepared(record, axle, settings, from_release, earliest_s)
    if isinstance(prepared, str):
        return prepared
    readings, priors, crossed = prepared
    omega = float(record.mode.angular_frequency[0]) if record.mode is not None else 0.0
    two = _two_modes(readings, omega, axle)
    found: dict[Elements, Optimum] = {}

    def try_(models: list[Elements], richer: Optimum | None = None) -> None:
        starts = [
            (m, x)
            for m in models
            for parent in ([richer] if richer is not None else _parents(m, found))
            for x in _starts(m, parent, priors, crossed, two, readings, record)
        ]
        if not starts:
            return
        for optimum in search(readings, priors, starts):
            if optimum.model not in found or optimum.squares < found[optimum.model].squares:
                found[optimum.model] = optimum

    def log_odds(optimum: Optimum, sd: float) -> float:
        odds = _log_odds(optimum.model, axle, neighbours)
        return optimum.evidence(sd) + odds + _repulsion(optimum, priors, axle)

    try_([frozenset()])
    best = found[frozenset()]
    while len(best.model) < _MOST_ELEMENTS and (fresh := [m for m in next_to(best.model) if m not in found]):
        try_(fresh)
        previous, best = best, max(found.values(), key=lambda o: log_odds(o, readings.sd))
        if best.model == previous.model:
            break
    # What the best model has too much of is seen from its own optimum only.
    try_(sorted((best.model - {e} for e in best.model), key=sorted), best)
    best = max(found.values(), key=lambda o: log_odds(o, readings.sd))
    sd = _effective_sd(readings, best)
    close = [o for o in found.values() if log_odds(o, sd) > log_odds(best, sd) - _CLOSE]
    if sd > 1.2 * readings.sd:
        # The priors weigh more beside readings that say less.
        wide = Readings(readings.time_s, readings.value, sd)
        close = search(wide, priors, [(o.model, o.x) for o in close], most=8)
    odds = np.array([log_odds(o, sd) for o in close])
    weight = np.exp(odds - odds.max())
    linear = max((o for m, o in found.items() if m <= _LINEAR_LAWS), key=lambda o: log_odds(o, sd))
    fit = _averaged(close, weight / weight.sum(), linear, sd, readings, priors, axle)
    if fit.unexplained > _UNEXPLAINED and fit.noise_ratio > _NOISE_RATIO:
        left = f"no quarter car explains the motion: {100.0 * fit.unexplained:.0f} % of the motion unexplained"
        return f"{left}, {fit.noise_ratio:.1f} times the noise (something else moved the axle, or many modes)"
    return fit


def _prepared(
    record: PreparedRecord, axle: AxleOnTire, settings: DropSettings, from_release: bool, earliest_s: float
) -> tuple[Readings, Priors, dict[str, float]] | str:
    """Readings of the free motion, the priors, and by name where the search of the linear quarter car begins."""
    if record.extrema is None or record.mode is None or record.release is None:
        return record.note
    period, release = record.period_s, record.release
    turns = record.extrema.time_s[record.extrema.time_s > max(release.first_turn_s + 0.25 * period, earliest_s)]
    if from_release:
        begin = release.time_s + 0.125 * period
    elif turns.size:
        begin = float(turns[0])
    else:
        return "no second turning point after the release"
    inside = (record.time_s >= begin) & (record.time_s <= begin + min(_LONGEST_PERIODS * period, _LONGEST_S))
    time, value = _averaged_readings(record.time_s[inside], record.value[inside])
    moving = np.flatnonzero(np.abs(value - record.mode.baseline) > _AT_REST * release.noise_sd + 1e-3 * np.ptp(value))
    until = time <= time[moving[-1]] + period if moving.size else np.zeros(time.size, bool)
    time, value = time[until], value[until]
    if time.size < _FEWEST_READINGS:
        return "too few readings after the second turning point for a free-decay model"
    place, rate, _, _ = local_polynomial(record.time_s, record.value, time[:1], 0.1 * period)
    if not np.isfinite(place[0]):
        return "too few readings where the free motion begins"
    level, omega = record.mode.baseline, float(record.mode.angular_frequency[0])
    amplitude = 0.5 * float(np.ptp(value))
    noise = max(high_frequency_noise(value), _MODEL_ERROR * amplitude)
    pole = complex(-max(float(record.mode.decay_rate[0]), 0.02 * omega), omega)
    stiffness, damping = _of_pole(pole, axle)
    critical = 2.0 * np.sqrt(stiffness * axle.mass)
    y, v = float(place[0]) - level, float(rate[0])
    ratio = stiffness / axle.tire_stiffness
    tolerances = (
        settings.tributary_mass_tolerance,
        settings.unsprung_mass_tolerance,
        settings.tire_stiffness_tolerance,
        settings.tire_damping_tolerance,
    )
    names = ("mass", "unsprung", "tire", "tire_damping")
    declared = (axle.mass, axle.unsprung_mass, axle.tire_stiffness, max(axle.tire_damping, 1.0))
    start = {"extension": y, "extension_rate": v, "wheel": ratio * y, "wheel_rate": ratio * v, "level": level}
    came_from = (float(np.sign(v)) if from_release else float(np.sign(y))) or 1.0
    priors = Priors.of(
        {
            "stiffness": (stiffness, 1.0),
            "damping": (_DAMPING_RATIO[0] * critical, _DAMPING_RATIO[1] * critical),
            **{n: (d, t) for n, d, t in zip(names, declared, tolerances, strict=True)},
            **{n: (m, _SPREAD_OF_START[n]) for n, m in start.items()},
            "drift": (0.0, _DRIFT_M_S),
            "friction": (0.0, _FRICTION_SHARE * axle.mass * STANDARD_GRAVITY_M_S2),
            "slip": _SLIP,
            "stuck": (came_from, 0.4),
            "bend": _BEND,
            "cubic": _CUBIC,
            "asymmetry": _ASYMMETRY,
            "quadratic": (0.0, _DAMPING_RATIO[1] * critical / _QUADRATIC_AT_M_S),
            "mode_omega": (omega * _MODE[0][0], _MODE[0][1]),
            "mode_ratio": _MODE[1],
            "mode_cosine": (0.0, 0.5 * amplitude),
            "mode_sine": (0.0, 0.5 * amplitude),
        }
    )
    return Readings(time, value, noise), priors, {"stiffness": stiffness, "damping": damping}


def _averaged_readings(time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of the readings of a fast log over some milliseconds."""
    if time.size < 3:
        return time, value
    block = max(int(_FINEST_S / float(np.median(np.diff(time)))), 1)
    first = np.arange(0, time.size, block)
    count = np.diff(first, append=time.size)
    return np.add.reduceat(time, first) / count, np.add.reduceat(value, first) / count


def _of_pole(pole: complex, axle: AxleOnTire) -> tuple[float, float]:
    """Stiffness and damping to begin with, from a pole of the body."""
    k, c = invert_quarter_car(pole, axle.mass, axle.unsprung_mass, axle.tire_stiffness, axle.tire_damping)
    # A body as stiff as its tire has a suspension that cannot be told.
    stiffness = float(k) if 0.0 < k < 3.0 * axle.tire_stiffness else axle.tire_stiffness
    return stiffness, max(float(c), 0.04 * np.sqrt(stiffness * axle.mass))


def _two_modes(readings: Readings, omega: float, axle: AxleOnTire) -> dict[str, float] | None:
    """The best fit of two decaying modes, the stronger one as that of the quarter car."""
    bounds = ((0.01 * omega, 0.7 * omega), (0.3 * omega, 3.0 * omega))
    first = (0.1 * omega, omega)
    fits = [
        fit_modes(readings.time_s, readings.value, [first, (0.1 * omega, f * omega)], [bounds, bounds])
        for f in _SECOND_MODE
    ]
    two = min((f for f in fits if f is not None), key=lambda f: f.residual_rms, default=None)
    if two is None:
        return None
    own, other = np.argsort(-(two.amplitude**2) / two.decay_rate)
    stiffness, damping = _of_pole(complex(-two.decay_rate[own], two.angular_frequency[own]), axle)
    waves = two.parameters[4:]
    ratio = stiffness / axle.tire_stiffness
    cosine, sine = waves[2 * own], waves[2 * own + 1]
    rate = -two.decay_rate[own] * cosine + two.angular_frequency[own] * sine
    return {
        "stiffness": stiffness,
        "damping": damping,
        "extension": cosine,
        "extension_rate": rate,
        "wheel": ratio * cosine,
        "wheel_rate": ratio * rate,
        "level": two.baseline,
        "mode_omega": two.angular_frequency[other],
        "mode_ratio": two.decay_rate[other] / two.angular_frequency[other],
        "mode_cosine": waves[2 * other],
        "mode_sine": waves[2 * other + 1],
    }


def _parents(model: Elements, found: Mapping[Elements, Optimum]) -> list[Optimum | None]:
    """The models with one element less that have been fitted, from whose optima a search begins."""
    return [found[p] for e in model if (p := model - {e}) in found] or [None]


def _starts(
    model: Elements,
    parent: Optimum | None,
    priors: Priors,
    crossed: dict[str, float],
    two: dict[str, float] | None,
    readings: Readings,
    record: PreparedRecord,
) -> list[np.ndarray]:
    """Where the searches of a model begin: at the optimum of its parent, with some of the element that is new."""
    if parent is None:
        return [priors.x(crossed)]
    own = priors.values(parent.x[None])[0]
    new = model - parent.model

    def with_(values: dict[str, float]) -> np.ndarray:
        moved = priors.x(values)
        names = np.array([PLACE[n] for n in values])
        x = parent.x.copy()
        x[names] = moved[names]
        return x

    damping = float(own[PLACE["damping"]])
    if "friction" in new:
        return [
            with_({"damping": 0.6 * damping, "friction": 0.3 * priors.sd[PLACE["friction"]], "slip": 1.5e-3}),
            with_({"damping": 0.2 * damping, "friction": 0.8 * priors.sd[PLACE["friction"]], "slip": 4e-3}),
        ]
    if "mode" in new:
        rest = readings.value - parent.curve
        seen = scan_single_mode(readings.time_s, rest, record.frequency_range_hz)
        starts = []
        if seen is not None:
            starts.append(with_({"mode_omega": 2.0 * np.pi * seen[0], "mode_ratio": max(seen[1], 0.02)}))
        if two is not None:
            starts.append(with_(two))
        return starts or [parent.x]
    return [parent.x]


def _log_odds(model: Elements, axle: AxleOnTire, neighbours: bool) -> float:
    """Logarithm of the odds of a model against the linear one, before the readings."""
    odds = {e: _ODDS[e] for e in model}
    if "friction" in odds:
        # Friction is positive: its prior has twice the density of a normal one.
        odds["friction"] *= 2.0 * (_LEAF_RUBS if axle.leaf else 1.0)
    if "mode" in odds and neighbours:
        odds["mode"] = _NEIGHBOURS_BEAT
    return float(sum(np.log(o) for o in odds.values()))


def _repulsion(optimum: Optimum, priors: Priors, axle: AxleOnTire) -> float:
    """Logarithm of the prior of the distance of two modes, by Wigner's surmise p(s) = pi s / 2 exp(-pi s^2 / 4)."""
    if "mode" not in optimum.model:
        return 0.0
    v = dict(zip(UNKNOWNS, priors.values(optimum.x[None])[0], strict=True))
    pole = eigenvalue_of_quarter_car(
        v["stiffness"], v["damping"], v["mass"], v["unsprung"], v["tire"], v["tire_damping"]
    )
    away = abs(float(np.log(v["mode_omega"] / pole.imag))) if np.isfinite(pole.imag) else _APART
    s = max(away, _CLOSEST) / _APART
    return float(np.log(0.5 * np.pi * s) - 0.25 * np.pi * s**2)


def _effective_sd(readings: Readings, best: Optimum) -> float:
    """Standard deviation of a reading times the square root of the number over which residuals are correlated."""
    rest = readings.value - best.curve
    rest = rest - rest.mean()
    size = rest.size
    lags = max(size // 10, 1)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(rest, 2 * size)) ** 2)[:lags]
    taper = 1.0 - np.arange(lags) / lags
    tau = max(1.0, float(2.0 * np.sum(taper * correlation) / max(correlation[0], 1e-300) - 1.0))
    scatter = np.sqrt(best.squares / max(size - np.count_nonzero(best.x), 1))
    return float(max(scatter, _MODEL_ERROR * float(np.ptp(best.curve))) * np.sqrt(tau))


def _averaged(
    close: list[Optimum],
    weight: np.ndarray,
    linear: Optimum,
    sd: float,
    readings: Readings,
    priors: Priors,
    axle: AxleOnTire,
) -> DecayFit:
    """Means over the models, and standard deviations whose 90 % intervals hold 90 % of all of them."""
    values = priors.values(np.stack([o.x for o in close]))
    covariances = np.stack([np.linalg.inv(o.curvature(sd)) for o in close])
    pair = [PLACE["stiffness"], PLACE["damping"]]
    # Stiffness is searched for as a logarithm.
    scale = priors.sd[pair] * np.stack([values[:, pair[0]], np.ones(len(close))], axis=1)
    scale = scale[:, :, None] * scale[:, None, :]
    own = covariances[:, pair][:, :, pair] * scale
    known = np.setdiff1d(np.arange(priors.sd.size), DECLARED)
    at = np.searchsorted(known, pair)
    given = np.stack([np.linalg.inv(o.curvature(sd)[np.ix_(known, known)])[np.ix_(at, at)] for o in close]) * scale
    mean = values[:, pair]
    middle = weight @ mean
    whole, read = np.einsum("m,mij->ij", weight, own), np.einsum("m,mij->ij", weight, given)
    strength, swap, other = _other_assignment(close, values, readings.time_s, axle)
    width = _widths(
        np.concatenate([mean, other]) - middle,
        np.sqrt(np.diagonal(np.concatenate([own, own]), axis1=1, axis2=2)),
        np.concatenate([weight * (1.0 - swap), weight * swap]),
    )
    correlation = whole[0, 1] / np.sqrt(whole[0, 0] * whole[1, 1])
    covariance = np.outer(width, width) * np.array([[1.0, correlation], [correlation, 1.0]])
    best = int(np.argmax(weight))
    misfit = float(np.sqrt(close[best].squares / readings.value.size)) / readings.sd
    # What repeats average out is the noise of the readings alone: not the declared quantities, not the choice of the
    # model, not what no model explains.
    averages_out = min(misfit**-2, 1.0) * np.minimum(np.diagonal(read), np.square(width))
    pole = eigenvalue_of_quarter_car(
        float(middle[0]), float(middle[1]), axle.mass, axle.unsprung_mass, axle.tire_stiffness, axle.tire_damping
    )

    def element(name: str, factor: float = 1.0) -> tuple[float, float]:
        """Mean and standard deviation of an unknown over the models that have it."""
        place = PLACE[name]
        has = np.array([bool(free(o.model)[place]) for o in close])
        if not has.any():
            return float("nan"), float("nan")
        share, value = weight[has] / weight[has].sum(), values[has, place]
        unit = priors.sd[place] * (value if place in LOGARITHMIC else np.ones(value.size))
        mean_of = float(share @ value)
        variance = share @ (covariances[has, place, place] * unit**2 + (value - mean_of) ** 2)
        return factor * mean_of, factor * float(np.sqrt(variance))

    beats = np.array(["mode" in o.model for o in close])
    return DecayFit(
        stiffness=float(middle[0]),
        damping=float(middle[1]),
        covariance=covariance,
        common_variance=np.square(width) - averages_out,
        damped_period=float(2.0 * np.pi / pole.imag),
        log_decrement=float(-2.0 * np.pi * pole.real / pole.imag),
        models=tuple((" + ".join(sorted(o.model)) or "linear", float(w)) for o, w in zip(close, weight, strict=True)),
        probability={e: float(sum(w for w, o in zip(weight, close, strict=True) if e in o.model)) for e in ELEMENTS},
        friction_force=element("friction"),
        slip_m=element("slip"),
        quadratic_damping=element("quadratic"),
        asymmetry=element("asymmetry"),
        bend_per_m=element("bend"),
        cubic_per_m2=element("cubic"),
        mode_hz=element("mode_omega", 0.5 / np.pi)[0],
        mode_strength=float(strength[np.argmax(np.where(beats, weight, -1.0))]),
        linear_bias=1.0 - middle / np.maximum(priors.values(linear.x[None])[0, pair], 1e-9),
        window_s=(float(readings.time_s[0]), float(readings.time_s[-1])),
        time_s=readings.time_s,
        model=close[best].curve,
        noise_ratio=misfit,
        unexplained=_unexplained(readings, close[best]),
    )


def _unexplained(readings: Readings, best: Optimum) -> float:
    """Residual over motion, both as root mean squares without the noise."""
    noise = readings.sd**2 * readings.value.size
    motion_squares = readings.value.size * float(np.var(readings.value))
    left = max(best.squares - noise, 0.0)
    return float(np.sqrt(left / max(motion_squares - noise, left, 1e-300)))


def _widths(away: np.ndarray, sd: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Standard deviations (2,) of normals whose 90 % intervals hold 90 % of a mixture of normals (m, 2) about them."""
    widths = []
    for i in range(2):
        d, s = away[:, i], sd[:, i]

        def held(width: float, d: np.ndarray = d, s: np.ndarray = s) -> float:
            reach = Z90 * width
            return float(share @ (ndtr((reach - d) / s) - ndtr((-reach - d) / s))) - 0.9

        most = float(np.max(np.abs(d) + 3.0 * s))
        widths.append(brentq(held, 0.0, most, xtol=1e-4 * float(s.min())))
    return np.array(widths)


def _other_assignment(
    close: list[Optimum], values: np.ndarray, time_s: np.ndarray, axle: AxleOnTire
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Strengths (m,) of the further modes, the odds (m,) that such a mode is the axle's own, and its k and c (m, 2).

    Nothing in a record says which of two modes is that of the axle; the stronger one is, with the odds of the energies.
    """
    strength, other = np.zeros(len(close)), np.ones((len(close), 2))
    body = motion(values, time_s)
    for i, o in enumerate(close):
        if "mode" in o.model:
            wave = beside(values[i : i + 1], time_s)[0]
            wave = wave - values[i, PLACE["level"]] - values[i, PLACE["drift"]] * (time_s - time_s[0])
            strength[i] = np.sqrt(np.sum(wave**2) / max(float(np.sum(body[i] ** 2)), 1e-300))
            omega, ratio = values[i, PLACE["mode_omega"]], values[i, PLACE["mode_ratio"]]
            other[i] = _of_pole(omega * complex(-ratio, 1.0), axle)
    return strength, strength**2 / (1.0 + strength**2), other
