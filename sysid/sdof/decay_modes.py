"""Decaying modes on a baseline: the signal model, its least-squares fit and honest covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sysid.arrays import Samples, UnknownsByUnknowns

_GRID_DAMPING_RATIOS = (0.003, 0.01, 0.03, 0.06, 0.1, 0.16, 0.25, 0.4)
_GRID_SAMPLES = 250  # enough for a start value; the refinement uses every sample
_MOST_GRID_SAMPLES = 20_000


@dataclass(frozen=True)
class ModeFit:
    """Least-squares fit of decaying modes on a constant (and optionally a linear drift).

    Mode q: exp(-sigma_q t) (a_q cos omega_q t + b_q sin omega_q t), with t from `start_s`. - `decay_rate` (modes,):
    sigma [1/s], and `angular_frequency` (modes,): omega [rad/s];
    - `amplitude` (modes,): sqrt(a^2 + b^2) at the start;
    - `baseline`, `drift_per_s`: constant and drift, both at the middle of the window;
    - `curvature`: kappa [1/s^2] of the log envelope exp(-sigma t + kappa t^2 / 2) of the first mode (0 unless fitted).
      `parameters` (p,) in the order sigma, omega per mode, kappa if fitted, then linear coefficients; `covariance` (p,
      p) allows for the autocorrelation of the `residual` (n,).
    """

    start_s: float
    decay_rate: np.ndarray
    angular_frequency: np.ndarray
    amplitude: np.ndarray
    baseline: float
    baseline_se: float
    drift_per_s: float
    drift_se: float
    curvature: float
    curvature_se: float
    parameters: np.ndarray
    covariance: np.ndarray
    model: np.ndarray
    residual: np.ndarray
    converged: bool

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, in the unit of the data."""
        return float(np.sqrt(np.mean(self.residual**2)))


def scan_single_mode(
    time_s: Samples, value: Samples, frequency_range_hz: tuple[float, float]
) -> tuple[float, float] | None:
    """Frequency [Hz] and damping ratio of the one decaying mode that explains most, by exhaustive search on a grid.

    At each grid point constant, drift, cosine and sine are solved for, so neither the offset nor the phase matters and
    a ripple of higher frequency cannot capture the search.  None where the record is shorter than a cycle or flat.
    """
    duration = float(time_s[-1] - time_s[0]) if time_s.size > 1 else 0.0
    if time_s.size < 8 or duration <= 0.0:
        return None
    low = max(frequency_range_hz[0], 0.75 / duration)
    high = frequency_range_hz[1]
    if low >= high:
        return None
    time, y = _thin(time_s, value, high)
    y = y - y.mean()
    drift = np.stack([np.ones_like(time), (time - time.mean()) / duration])
    drift = np.linalg.qr(drift.T)[0].T
    y = y - drift.T @ (drift @ y)
    if not np.any(np.abs(y) > 1e-14 * max(1.0, float(np.abs(value).max()))):
        return None
    frequencies = np.geomspace(low, high, int(np.clip(60 * np.log(high / low), 40, 240)))
    u = time - time[0]
    best, mode = -1.0, None
    for ratio in _GRID_DAMPING_RATIOS:
        omega = 2.0 * np.pi * frequencies[:, None]
        envelope = np.exp(-ratio * omega * u)
        columns = np.stack([envelope * np.cos(omega * u), envelope * np.sin(omega * u)], axis=1)  # (f, 2, n)
        columns -= (columns @ drift.T) @ drift
        gram = columns @ columns.transpose(0, 2, 1)
        project = columns @ y
        determinant = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
        explained = (
            gram[:, 1, 1] * project[:, 0] ** 2
            - 2 * gram[:, 0, 1] * project[:, 0] * project[:, 1]
            + gram[:, 0, 0] * project[:, 1] ** 2
        )
        safe = determinant > 1e-9 * gram[:, 0, 0] * gram[:, 1, 1]
        explained = np.where(safe, explained / np.where(safe, determinant, 1.0), 0.0)
        index = int(np.argmax(explained))
        if explained[index] > best:
            best, mode = float(explained[index]), (float(frequencies[index]), ratio)
    return mode


def _thin(time_s: np.ndarray, value: np.ndarray, high_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Block means, not coarser than eight per cycle of the highest frequency, to bound the cost of the scan."""
    rate = (time_s.size - 1) / (time_s[-1] - time_s[0])
    block = int(min(max(1, time_s.size // _GRID_SAMPLES), max(1, rate // (8.0 * high_hz))))
    # A gap makes the mean rate small and the block with it; the scan must not take memory for every sample then.
    block = max(block, -(-time_s.size // _MOST_GRID_SAMPLES))
    length = time_s.size // block * block
    return time_s[:length].reshape(-1, block).mean(axis=1), value[:length].reshape(-1, block).mean(axis=1)


def _design(
    nonlinear: np.ndarray, u: np.ndarray, modes: int, curved: bool, drift: bool
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Columns of the linear coefficients: cosine and sine per mode, constant, drift."""
    columns = []
    for mode in range(modes):
        sigma, omega = nonlinear[2 * mode], nonlinear[2 * mode + 1]
        exponent = -sigma * u
        if curved and mode == 0:
            exponent = exponent + 0.5 * nonlinear[2 * modes] * u**2
        envelope = np.exp(np.clip(exponent, -700.0, 50.0))
        columns += [envelope * np.cos(omega * u), envelope * np.sin(omega * u)]
    baseline = [np.ones_like(u)]
    if drift:
        baseline.append(u - 0.5 * u[-1])
    return np.stack(columns + baseline, axis=1), columns


def _jacobian(parameters: np.ndarray, u: np.ndarray, modes: int, curved: bool, drift: bool) -> np.ndarray:
    count = 2 * modes + int(curved)
    design, columns = _design(parameters[:count], u, modes, curved, drift)
    linear = parameters[count:]
    derivative = np.empty((u.size, count))
    for mode in range(modes):
        cosine, sine = columns[2 * mode], columns[2 * mode + 1]
        a, b = linear[2 * mode], linear[2 * mode + 1]
        derivative[:, 2 * mode] = -u * (a * cosine + b * sine)
        derivative[:, 2 * mode + 1] = u * (b * cosine - a * sine)
    if curved:
        derivative[:, -1] = 0.5 * u**2 * (linear[0] * columns[0] + linear[1] * columns[1])
    return np.concatenate([derivative, design], axis=1)


def fit_modes(
    time_s: Samples,
    value: Samples,
    starts: list[tuple[float, float]],
    bounds: list[tuple[tuple[float, float], tuple[float, float]]],
    *,
    drift: bool = False,
    curved: bool = False,
) -> ModeFit | None:
    """Fit decaying modes on a constant by least squares, all coefficients together.

    Parameters
    ----------
    time_s, value
        (n,) increasing times [s] and finite readings.
    starts
        Per mode the start values (decay rate [1/s], angular frequency [rad/s]).
    bounds
        Per mode ((lowest, highest decay rate), (lowest, highest angular frequency)).
    drift, curved
        Whether to add a linear drift, and a curvature of the first mode's log envelope.

    Returns
    -------
    ModeFit or None
        None where there are fewer readings than coefficients or they do not move.
    """
    modes = len(starts)
    u = time_s - time_s[0]
    centre, scale = float(value.mean()), float(value.std())
    count = 2 * modes + int(curved)
    if u.size < count + 2 * modes + 2 + 2 or scale <= 1e-13 * max(1.0, abs(centre)):
        return None
    y = (value - centre) / scale
    nonlinear, lower, upper = _start_and_bounds(starts, bounds, curved, float(u[-1]))
    linear = np.linalg.lstsq(_design(nonlinear, u, modes, curved, drift)[0], y, rcond=None)[0]
    free = np.full(linear.size, np.inf)

    def residual(p: np.ndarray) -> np.ndarray:
        return np.asarray(_design(p[:count], u, modes, curved, drift)[0] @ p[count:] - y)

    def jacobian(p: np.ndarray) -> np.ndarray:
        return _jacobian(p, u, modes, curved, drift)

    solution = least_squares(
        residual,
        np.concatenate([nonlinear, linear]),
        jac=jacobian,
        bounds=(np.concatenate([lower, -free]), np.concatenate([upper, free])),
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=300,
    )
    p = solution.x
    rescale = np.concatenate([np.full(count, 1.0 / scale), np.ones(linear.size)])
    covariance = scale**2 * correlated_covariance(jacobian(p), solution.fun) * np.outer(rescale, rescale)
    linear = scale * p[count:]
    baseline = 2 * modes
    variances = np.diagonal(covariance)
    return ModeFit(
        start_s=float(time_s[0]),
        decay_rate=p[0 : 2 * modes : 2].copy(),
        angular_frequency=p[1 : 2 * modes : 2].copy(),
        amplitude=np.hypot(linear[0:baseline:2], linear[1:baseline:2]),
        baseline=centre + float(linear[baseline]),
        baseline_se=float(np.sqrt(variances[count + baseline])),
        drift_per_s=float(linear[baseline + 1]) if drift else 0.0,
        drift_se=float(np.sqrt(variances[count + baseline + 1])) if drift else 0.0,
        curvature=float(p[2 * modes]) if curved else 0.0,
        curvature_se=float(np.sqrt(variances[2 * modes])) if curved else 0.0,
        parameters=np.concatenate([p[:count], linear]),
        covariance=covariance,
        model=centre + scale * (y + solution.fun),
        residual=-scale * solution.fun,
        converged=bool(solution.status > 0),
    )


def _start_and_bounds(
    starts: list[tuple[float, float]],
    bounds: list[tuple[tuple[float, float], tuple[float, float]]],
    curved: bool,
    length_s: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start values of rates, frequencies and curvature, inside their lowest and highest values."""
    start = np.array([x for pair in starts for x in pair] + [0.0] * curved, float)
    lower = np.array([x[0] for bound in bounds for x in bound])
    upper = np.array([x[1] for bound in bounds for x in bound])
    if curved:
        limit = 4.0 * max(start[0], 0.05 * start[1]) / max(length_s, 1e-9)
        lower, upper = np.append(lower, -limit), np.append(upper, limit)
    return np.clip(start, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower)), lower, upper


def mode_curve(fit: ModeFit, time_s: Samples, mode: int) -> Samples:
    """The part of one mode in a fit without curvature, (n,) at `time_s` [s], in the unit of the data."""
    u = time_s - fit.start_s
    cosine, sine = fit.parameters[2 * fit.decay_rate.size + 2 * mode :][:2]
    phase = fit.angular_frequency[mode] * u
    return np.asarray(np.exp(-fit.decay_rate[mode] * u) * (cosine * np.cos(phase) + sine * np.sin(phase)))


def correlated_covariance(jacobian: np.ndarray, residual: Samples) -> UnknownsByUnknowns:
    """Covariance of least-squares estimates whose residuals are autocorrelated.

    (J'J)^-1 J' Sigma J (J'J)^-1 with Sigma the Toeplitz matrix of the residual's autocovariance under a Bartlett taper
    over a tenth of the record, never below the independent-noise covariance (Newey and West 1987,
    doi:10.2307/1913610).

    Parameters
    ----------
    jacobian, residual
        (n, p), (n,) at even steps of time.
    """
    samples, count = jacobian.shape
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / scale
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-14)
    freedom = max(samples - count, 1)
    lags = max(1, samples // 10)
    length = 2 * samples
    spectrum = np.fft.rfft(residual, length)
    autocovariance = np.fft.irfft(np.abs(spectrum) ** 2, length)[: lags + 1] / freedom
    taper = 1.0 - np.arange(lags + 1) / (lags + 1.0)
    kernel = np.zeros(length)
    kernel[: lags + 1] = autocovariance * taper
    kernel[length - lags :] = (autocovariance * taper)[1:][::-1]
    filtered = np.fft.irfft(np.fft.rfft(kernel)[:, None] * np.fft.rfft(scaled, length, axis=0), length, axis=0)
    independent = autocovariance[0] * bread
    robust = bread @ (scaled.T @ filtered[:samples]) @ bread
    inflation = np.sqrt(np.maximum(np.diagonal(robust) / np.maximum(np.diagonal(independent), 1e-300), 1.0))
    correlation_source = robust if np.all(np.diagonal(robust) > 0.0) else independent
    spread = np.sqrt(np.maximum(np.diagonal(correlation_source), 1e-300))
    sd = np.sqrt(np.maximum(np.diagonal(independent), 0.0)) * inflation
    return np.asarray((correlation_source / np.outer(spread, spread)) * np.outer(sd, sd) / np.outer(scale, scale))
