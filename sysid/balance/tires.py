"""Tires, speed and road of drives: all axles roll over one unknown road, one after the other.

The height of the road as axle j feels it follows from its motion and its load,

    h_j = z_j + T_j / (kt_j + i omega ct_j) = E_j(n) r(t - x_j / v),

E_j the mean over the contact of a tire (:mod:`sysid.road.footprint_filter`), n = omega / (2 pi v). Moved forward by
x_j / v, all h_j are the same but for noise. In windows of 8 s they are normal at every frequency (Whittle) with

    S = s (E E^T + eta I) + N,      -log L = sum log |S| - 2 log |det(I + H / Kt)| + h^H S^-1 h,

s(omega) the spectrum of the road, log-linear between knots, so that no law of its waviness is needed; eta what differs
from axle to axle; N the noise of the sensors; H the loads by the motion of all axles, the bodies following. The second
term is the Jacobian from motion to road. kt and ct of all axles, the speed in every window, s and eta are estimated;
records are moved along the road by the speed as it is found, first at low frequencies.

Laws, unsprung masses and gains stay as the balance has them. What they would move, to first order, widens the
intervals: their covariance goes through I^-1 I_c, I the information about tires and I_c that about tires and them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sysid.balance.axle_loads import Force, fewer, slower
from sysid.balance.equations import BAND_HZ, Block
from sysid.balance.motion import END_S, smoother, stretching
from sysid.balance.records import BalanceEstimate, DrivenRoad
from sysid.balance.search import Found
from sysid.display import Z90
from sysid.road.footprint_filter import footprint_filter
from sysid.road.roughness import REFERENCE_WAVE_NUMBER, class_of_density

#: Windows [s]; neighbours overlap by half, so that each counts half.
_WINDOW_S, _WEIGHT = 8.0, 0.5
#: Least number of windows of a drive.
_LEAST_WINDOWS = 3
#: Knots of the road's spectrum, and frequencies of those of what differs from axle to axle [Hz].
_KNOTS, _APART_HZ = 8, (BAND_HZ[0], 4.0, BAND_HZ[1])
#: Standard deviations about nominal values, of logarithms: wide ones of tires, and of the speed, which drifts.
_TIRE_SD, _SPEED_SD = (0.5, 1.0), 0.02
#: Highest frequencies of the first rounds, for the speed alone, while delays are uncertain; then all, with tires.
_FIRST_HZ = (3.0, 3.0, 3.0, 8.0, 8.0)
_ROUNDS, _STEP = 40, 0.2
#: The search ends where no tire moves by more than this share, or part of its standard deviation; records are moved
#: again where a speed does.
_CLOSE, _CLOSE_SD, _MOVED = 2e-3, 0.1, 1e-4
#: Axles do not roll over one road if this share of the power differs between them, from 0.7 to 4 Hz (an assumption).
APART = 0.3
#: Standard deviation of the distance between first and last axle (an assumption) [m].
_PLACE_SD_M = 0.01
#: Exponent of a spoke of the contact, median of the calibration over bumps less one half.
_SPOKE = 0.7


@dataclass
class _Drive:
    """One stretch: motion and load of axles, the speed along it, and what windows and search make of them.

    Arrays of windows are (F, na, w). `motion` and `load` of every axle over time [s]; `speed` (n,) [m/s], `centres`
    (w,) samples; `road` and `apart` are logarithms at knots.
    """

    block: Block
    forces: list[Force]
    motion: list[CubicSpline]
    load: list[CubicSpline]
    speed: np.ndarray
    omega: np.ndarray
    answer: np.ndarray
    noise: np.ndarray
    of_load: np.ndarray
    knots: np.ndarray
    hats: np.ndarray
    apart_hats: np.ndarray
    road: np.ndarray
    apart: np.ndarray
    z: np.ndarray
    t: np.ndarray
    shifted_s: np.ndarray

    @property
    def window(self) -> int:
        return round(_WINDOW_S / self.step_s)

    @property
    def step_s(self) -> float:
        return self.forces[0].step_s

    @property
    def centres(self) -> np.ndarray:
        return np.asarray(self.window // 2 * (np.arange(self.z.shape[2]) + 1))

    def windows(self, values: np.ndarray) -> np.ndarray:
        """Spectra (F, w) of a record (n,) in windows, white noise keeping its variance."""
        size, hop = self.window, self.window // 2
        weight = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
        views = np.lib.stride_tricks.sliding_window_view(values, size)[::hop]
        first = round(self.omega[0] / (2.0 * np.pi) * _WINDOW_S)
        spectra = np.fft.rfft(views * weight, axis=1)[:, first : first + self.omega.size]
        return np.asarray(spectra.T / np.sqrt(np.sum(weight**2)))

    def move(self) -> None:
        """Windows of motion and load of every axle while it passes where axle 1 was."""
        step, n = self.step_s, self.speed.size
        time = step * np.arange(n)
        station = np.concatenate([[0.0], np.cumsum(0.5 * (self.speed[1:] + self.speed[:-1])) * step])
        behind = np.array([a.x_m for a in self.block.vehicle.axles])
        count = int(np.searchsorted(station, station[-1] - behind.max()))
        self.shifted_s = np.array([np.interp(station[:count] + x, station, time) for x in behind])
        self.z, self.t = (
            np.stack([self.windows(at(s)) for at, s in zip(splines, self.shifted_s, strict=True)], axis=1)
            for splines in (self.motion, self.load)
        )


def _drive(block: Block, forces: list[Force]) -> _Drive | None:
    step, speed, n = forces[0].step_s, block.passage.speed_m_s, forces[0].value.size
    behind = max(a.x_m for a in block.vehicle.axles)
    needed = (_LEAST_WINDOWS + 1) / 2.0 * _WINDOW_S + 2.0 * END_S
    if not speed or n * step < needed + 1.1 * behind / speed:
        return None
    inside = slice(int(END_S / step), n - int(END_S / step))
    na, nu = len(forces), block.columns.size
    frequency = (
        np.arange(math.ceil(BAND_HZ[0] * _WINDOW_S), int(min(BAND_HZ[1], 0.4 / step) * _WINDOW_S) + 1) / _WINDOW_S
    )
    omega = 2.0 * np.pi * frequency
    rows = stretching(block.matrices)
    of_load = np.array([f.of_state(omega, i, rows) for i, f in enumerate(forces)])
    _, covariance = smoother(block.stretch, omega)
    # Of white noise, readings further apart keep the part below half of their frequency.
    covariance = covariance / fewer(block)
    # The bodies follow the axles.
    m = block.matrices
    attachment, square = m.attachment[:, block.columns], np.ix_(block.columns, block.columns)
    dynamic = np.array([f.dynamic[0] + 1j * omega * f.dynamic[1] for f in forces]).T
    body = -(omega**2)[:, None, None] * m.mass[square] + m.tilt[square]
    body = body + (attachment.T * dynamic[:, None, :]) @ attachment
    stretched = attachment @ np.linalg.solve(body, attachment.T * dynamic[:, None, :]) - np.eye(na)
    answer = -dynamic[:, :, None] * stretched
    answer[:, np.arange(na), np.arange(na)] -= m.unsprung_mass * (omega**2)[:, None]
    knots = np.geomspace(frequency[0], frequency[-1], _KNOTS)

    def hats(places: np.ndarray) -> np.ndarray:
        return np.array([np.interp(np.log(frequency), np.log(places), e) for e in np.eye(places.size)])

    nothing, count = np.empty(0), n - 2 * inside.start
    displaced = slower(block, block.motion.displacement[nu:])
    motion, load = ([CubicSpline(step * np.arange(count), v[inside]) for v in values]
                    for values in (displaced, [f.value for f in forces]))  # fmt: skip
    drive = _Drive(
        block, forces, motion, load, np.full(count, speed), omega, answer, covariance, of_load, knots, hats(knots),
        hats(np.array(_APART_HZ)), nothing, np.log([0.1, 0.2, 0.5]), nothing, nothing, nothing,
    )  # fmt: skip
    drive.move()
    return drive


def _contact(drive: _Drive, stiffness: np.ndarray) -> np.ndarray:
    """E (F, na): what the mean over the contact leaves of a wave of the road."""
    speed, load = float(drive.speed.mean()), drive.block.matrices.static_load
    wave = drive.omega / speed
    left = np.empty((wave.size, load.size))
    for i, axle in enumerate(drive.block.vehicle.axles):
        deflection = min((_SPOKE + 0.5) * load[i] / stiffness[i], 0.3 * axle.tire_radius_m)
        weights = footprint_filter(axle.tire_radius_m, deflection, load[i], stiffness[i], _SPOKE, 0.01)
        place = weights.step_m * (np.arange(weights.rise.size) - weights.rise.size // 2)
        left[:, i] = np.cos(wave[:, None] * place) @ weights.rise
    return left


@dataclass(frozen=True)
class _Point:
    """Likelihood of a drive at one point: `inverse` S^-1 (F, na, na), and derivatives as they are named below."""

    inverse: np.ndarray
    score: np.ndarray
    information: np.ndarray
    variance_score: np.ndarray
    variance_information: np.ndarray
    tires: tuple[np.ndarray, np.ndarray]
    delays: np.ndarray
    dynamic: np.ndarray


def _evaluate(drive: _Drive, kt: np.ndarray, ct: np.ndarray, highest_hz: float) -> _Point:
    """Score and information about (ln kt, ln ct, relative speeds of windows), and about road and what differs."""
    used = drive.omega <= 2.0 * np.pi * highest_hz + 1e-9
    omega = drive.omega[used]
    z, t, answer = drive.z[used], drive.t[used], drive.answer[used]
    count = z.shape[2]
    dynamic = kt + 1j * omega[:, None] * ct
    h = z + t / dynamic[:, :, None]
    contact = _contact(drive, kt)[used]
    road, apart = np.exp(drive.road @ drive.hats[:, used]), np.exp(drive.apart @ drive.apart_hats[:, used])
    rows = np.moveaxis(drive.of_load[:, used], 0, 1) / dynamic[:, :, None]
    nu = rows.shape[2] - kt.size
    rows[:, np.arange(kt.size), nu + np.arange(kt.size)] += 1.0
    noise = np.einsum("fjx,fxy,fjy->fj", rows, drive.noise[used], np.conj(rows)).real
    eye, same = np.eye(kt.size), contact[:, :, None] * contact[:, None, :]
    inverse = np.linalg.inv(road[:, None, None] * (same + apart[:, None, None] * eye) + noise[:, :, None] * eye)
    r = inverse @ h
    by_kt, by_ct = -kt / dynamic**2, -1j * omega[:, None] * ct / dynamic**2
    tires = by_kt[:, :, None] * t, by_ct[:, :, None] * t
    behind = np.array([a.x_m for a in drive.block.vehicle.axles])
    speeds = drive.speed[np.minimum(drive.centres, drive.speed.size - 1)]
    delays = -1j * omega[:, None, None] * behind[:, None] * h / speeds
    # Jacobian of the road by the motion of the axles.
    through = np.linalg.inv(eye + answer / dynamic[:, :, None])
    gain = np.einsum("fij,fji->fi", answer, through)
    n = kt.size
    score, information = np.zeros(2 * n + count), np.zeros((2 * n + count, 2 * n + count))
    turned = inverse @ delays
    score[2 * n :] = 2.0 * np.sum(np.conj(r) * delays, axis=(0, 1)).real
    information[2 * n :, 2 * n :] = np.diag(2.0 * np.sum(np.conj(delays) * turned, axis=(0, 1)).real)
    for a, (tire, by) in enumerate(zip(tires, (by_kt, by_ct), strict=True)):
        rows_a = slice(a * n, (a + 1) * n)
        score[rows_a] = 2.0 * np.sum(np.conj(r) * tire, axis=(0, 2)).real
        score[rows_a] -= 2.0 * count * np.sum(by * gain, axis=0).real
        cross = 2.0 * np.sum(np.conj(tire) * turned, axis=0).real
        information[rows_a, 2 * n :], information[2 * n :, rows_a] = cross, cross.T
        for b, other in enumerate(tires):
            pairs = np.conj(tire) @ np.swapaxes(other, 1, 2)
            information[rows_a, b * n : (b + 1) * n] = 2.0 * np.sum(inverse * pairs, axis=0).real
    changes = [(b * road)[:, None, None] * (same + apart[:, None, None] * eye) for b in drive.hats[:, used]]
    changes += [(b * road * apart)[:, None, None] * eye for b in drive.apart_hats[:, used]]
    each = [inverse @ c for c in changes]
    mean = r @ np.conj(np.swapaxes(r, 1, 2))
    by_variance = np.array(
        [count * np.trace(e, axis1=1, axis2=2).sum().real - np.sum(c * np.swapaxes(mean, 1, 2)).real
         for e, c in zip(each, changes, strict=True)]
    )  # fmt: skip
    of_variance = count * np.array([[np.sum(e * np.swapaxes(f, 1, 2)).real for f in each] for e in each])
    w = _WEIGHT
    return _Point(inverse, w * score, w * information, w * by_variance, w * of_variance, tires, delays, dynamic)


def _renew_road(drive: _Drive, point: _Point) -> None:
    step = np.linalg.solve(point.variance_information + 0.01 * np.eye(point.variance_score.size), -point.variance_score)
    step = np.clip(step, -1.0, 1.0)
    drive.road = drive.road + step[:_KNOTS]
    drive.apart = np.clip(drive.apart + step[_KNOTS:], -9.0, 3.0)


@dataclass(frozen=True)
class _Fitted:
    kt: np.ndarray
    ct: np.ndarray
    covariance: np.ndarray
    converged: bool


def _search(drives: Sequence[_Drive], kt0: np.ndarray, ct0: np.ndarray) -> _Fitted:
    n = kt0.size
    nominal = np.log(np.concatenate([kt0, ct0]))
    prior = np.repeat(np.array(_TIRE_SD) ** -2.0, n)
    x = nominal.copy()
    for drive in drives:
        h = drive.z + drive.t / (kt0 + 1j * drive.omega[:, None] * ct0)[:, :, None]
        level = np.log(np.mean(np.abs(h) ** 2, axis=(1, 2)))
        drive.road = np.interp(np.log(drive.knots), np.log(drive.omega / (2.0 * np.pi)), level)
    converged = False
    information = np.diag(prior)
    for rounds in range(_ROUNDS):
        highest = _FIRST_HZ[rounds] if rounds < len(_FIRST_HZ) else BAND_HZ[1]
        information, score = np.diag(prior), prior * (x - nominal)
        parts = []
        for drive in drives:
            _renew_road(drive, _evaluate(drive, np.exp(x[:n]), np.exp(x[n:]), highest))
            point = _evaluate(drive, np.exp(x[:n]), np.exp(x[n:]), highest)
            speeds = drive.speed[np.minimum(drive.centres, drive.speed.size - 1)]
            off = np.log(speeds / drive.block.passage.speed_m_s)
            own = np.linalg.inv(point.information[2 * n :, 2 * n :] + np.eye(off.size) / _SPEED_SD**2)
            cross = point.information[: 2 * n, 2 * n :]
            by_speed = point.score[2 * n :] + off / _SPEED_SD**2
            information += point.information[: 2 * n, : 2 * n] - cross @ own @ cross.T
            score = score + point.score[: 2 * n] - cross @ own @ by_speed
            parts.append((drive, own, cross, by_speed))
        step = np.zeros(2 * n)
        if rounds >= len(_FIRST_HZ):
            step = np.clip(-np.linalg.solve(information, score), -_STEP, _STEP)
        x = x + step
        close = np.maximum(_CLOSE, _CLOSE_SD * np.sqrt(np.diag(np.linalg.inv(information))))
        moved = 0.0
        for drive, own, cross, by_speed in parts:
            faster = np.clip(-own @ (by_speed + cross.T @ step), -_SPEED_SD, _SPEED_SD)
            moved = max(moved, float(np.abs(faster).max()))
            if np.abs(faster).max() > _MOVED:
                drive.speed = drive.speed * np.exp(np.interp(np.arange(drive.speed.size), drive.centres, faster))
                drive.move()
        if rounds > len(_FIRST_HZ) and np.all(np.abs(step) < close) and moved < 10.0 * _MOVED:
            converged = True
            break
    return _Fitted(np.exp(x[:n]), np.exp(x[n:]), np.linalg.inv(information), converged)


def _carried(drives: Sequence[_Drive], fitted: _Fitted, found: Found) -> np.ndarray:
    """Information (2 na, unknowns of the balance) about tires and what the balance has found."""
    n, total = fitted.kt.size, np.zeros((2 * fitted.kt.size, found.covariance.shape[0]))
    for drive in drives:
        point = _evaluate(drive, fitted.kt, fitted.ct, BAND_HZ[1])
        begin = int(END_S / drive.step_s)
        time = drive.step_s * np.arange(drive.speed.size)
        count = drive.speed.size
        own = np.linalg.inv(point.information[2 * n :, 2 * n :] + np.eye(drive.z.shape[2]) / _SPEED_SD**2)
        through = point.information[: 2 * n, 2 * n :] @ own
        turned = [point.inverse @ d for d in (*point.tires, point.delays)]
        for j, force in enumerate(drive.forces):
            for place, series in zip(force.places.tolist(), force.by, strict=True):
                moved = np.interp(drive.shifted_s[j], time, series[begin : begin + count])
                change = drive.windows(moved) / point.dynamic[:, j, None]
                tires = [2.0 * _WEIGHT * np.einsum("fi,fiw,fw->i", point.inverse[:, :, j], np.conj(d), change).real
                         for d in point.tires]  # fmt: skip
                delays = 2.0 * _WEIGHT * np.sum(np.conj(turned[2][:, j]) * change, axis=0).real
                total[:, place] += np.concatenate(tires) - through @ delays
    return total


def tires_of(
    driven: Sequence[tuple[Block, list[Force]]], found: Found, scale_sd: float
) -> tuple[tuple[BalanceEstimate, ...], tuple[DrivenRoad, ...], tuple[str, ...]]:
    """Tires of all axles per load case, speed and road of every drive, and sentences on what is not told.

    Parameters
    ----------
    driven
        Stretches of drives with their forces.
    found
        Of the balance.
    scale_sd
        Standard deviation of the logarithm of a factor on all masses and forces.
    """
    estimates: list[BalanceEstimate] = []
    roads: list[DrivenRoad] = []
    sentences: list[str] = []
    cases = list(dict.fromkeys(b.passage.load_case for b, _ in driven))
    for case in cases:
        drives = []
        for block, forces in driven:
            if block.passage.load_case == case:
                drive = _drive(block, forces)
                if drive is None:
                    sentences.append(
                        f"{block.passage.file} is too short to compare its axles: tires and road need 18 s and the "
                        "time from the first to the last axle, without a gap."
                    )
                else:
                    drives.append(drive)
        told, roads_of_case, said = _of_case(drives, found, case if len(cases) > 1 else None, scale_sd)
        estimates += told
        roads += roads_of_case
        sentences += said
    return tuple(estimates), tuple(roads), tuple(sentences)


def _of_case(
    drives: list[_Drive], found: Found, case: str | None, scale_sd: float
) -> tuple[list[BalanceEstimate], list[DrivenRoad], list[str]]:
    sentences: list[str] = []
    while drives:
        axles = drives[0].block.vehicle.axles
        fitted = _search(
            drives,
            np.array([a.tire_stiffness_N_per_m for a in axles]),
            np.array([max(a.tire_damping_N_s_per_m, 500.0) for a in axles]),
        )
        odd = [d for d in drives if math.exp(float(d.apart[0])) > APART or math.exp(float(d.apart[1])) > APART]
        if not odd:
            break
        for drive in odd:
            sentences.append(
                f"{drive.block.passage.file}: the axles do not roll over one road, one after the other at "
                f"{3.6 * (drive.block.passage.speed_m_s or 0.0):.0f} km/h; look at the places of the axles, the speed, "
                "and the sensors of the axles. It tells nothing of tires and road."
            )
        drives = [d for d in drives if d not in odd]
    if not drives:
        return [], [], sentences
    if not fitted.converged:
        sentences.append("The search for the tires has not converged: their values are not final.")
    carried = fitted.covariance @ _carried(drives, fitted, found)
    covariance = fitted.covariance + carried @ found.covariance @ carried.T
    # What the balance may have wrong says no less of a tire than its nominal value.
    wide = np.repeat(np.array(_TIRE_SD) ** -2.0, len(axles))
    variance = 1.0 / (1.0 / np.diag(covariance) + wide)
    sd = np.hypot(np.sqrt(variance), scale_sd).tolist()
    estimates = []
    for k, (symbol, quantity, unit, values) in enumerate(
        (("kt", "tire_stiffness", "N/m", fitted.kt), ("ct", "tire_damping", "N s/m", fitted.ct))
    ):
        for i, value in enumerate(values.tolist()):
            s = sd[k * len(axles) + i]
            name = f"{symbol}_{i + 1}" + ("" if case is None else f"[{case}]")
            ends = value * math.exp(-Z90 * s), value * math.exp(Z90 * s)
            estimates.append(BalanceEstimate(name, quantity, i, case, unit, value, *ends, s))
    vague = [e.name for e in estimates if not e.determined]
    if vague:
        sentences.append(f"Drives do not tell {', '.join(vague)} within a factor of 1.5.")
    return estimates, [_road(d, fitted) for d in drives], sentences


def _road(drive: _Drive, fitted: _Fitted) -> DrivenRoad:
    """G_d = G_d(n_0) (n / n_0)^-w by weighted least squares over the knots of the spectrum."""
    point = _evaluate(drive, fitted.kt, fitted.ct, BAND_HZ[1])
    speed = float(drive.speed.mean())
    covariance = np.linalg.inv(point.variance_information)[:_KNOTS, :_KNOTS]
    level = drive.road + math.log(2.0 * drive.step_s * speed)
    wave = np.log(drive.knots / speed / REFERENCE_WAVE_NUMBER)
    design = np.stack([np.ones_like(wave), -wave], axis=1)
    weighted = design.T @ np.linalg.inv(covariance)
    own = np.linalg.inv(weighted @ design)
    (density, waviness) = own @ weighted @ level
    left = level - design @ np.array([density, waviness])
    spread = max(1.0, float(left @ np.linalg.inv(covariance) @ left) / (_KNOTS - 2))
    sd = math.sqrt(spread * own[0, 0])
    value = math.exp(density)
    n = fitted.kt.size
    precise = np.diag(point.information)[2 * n :]
    behind = max(a.x_m for a in drive.block.vehicle.axles)
    speed_sd = math.hypot(1.0 / math.sqrt(float(np.sum(precise))), _PLACE_SD_M / behind)
    return DrivenRoad(
        drive.block.passage.file, drive.block.passage.load_case, speed, speed * math.exp(-Z90 * speed_sd),
        speed * math.exp(Z90 * speed_sd), value, value * math.exp(-Z90 * sd), value * math.exp(Z90 * sd),
        float(waviness), class_of_density(value), math.exp(float(drive.apart[1])),
    )  # fmt: skip
