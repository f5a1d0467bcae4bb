"""Rough roads: profiles of the classes of ISO 8608, the class of a given profile, and the roughness index (IRI)."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter
from scipy.special import gamma, kv

from sysid.arrays import Stations
from sysid.campaign.roads import ROAD_CLASSES, RoadClass

#: Displacement spectral density of the centre of class A [m3] at the reference wave number [cycles/m]; every class has
#: four times that of the one before (ISO 8608:2016, table A.1); waviness.  The band of wave numbers [cycles/m] begins
#: where the standard's does and goes on beyond its 2.83: without the shortest waves wheels without a footprint have 3 %
#: less dynamic load.
CLASS_A_M3 = 16e-6
REFERENCE_WAVE_NUMBER = 0.1
BAND = (0.011, 10.0)
WAVINESS = 2.0
#: Distance of the stations of roads of a class [m]: four in the shortest wave.
STATION_STEP_M = 0.025
#: Distance of the tracks of wheels where the vehicle does not say its own [m] (an assumption).
TRACK_M = 2.0
#: Waves are whole parts of a length that exceeds the road by this [m], and is no shorter than ten of the longest.
_BEYOND_M = 200.0
#: Golden car: k_t / m_s, k / m_s [1/s2], c / m_s [1/s], m_u / m_s, and its speed [m/s] (M. W. Sayers, "On the
#: calculation of International Roughness Index from longitudinal road profile", Transportation Research Record 1501,
#: 1995).
GOLDEN_CAR = (653.0, 63.3, 6.0, 0.15)
GOLDEN_SPEED_M_S = 80.0 / 3.6


def class_density(name: RoadClass) -> float:
    """Displacement spectral density G_d(n_0) of the centre of a class [m3] at n_0 = 0.1 cycles/m."""
    return CLASS_A_M3 * 4.0 ** ROAD_CLASSES.index(name)


def track_coherence(wave_number: np.ndarray, track_m: float, waviness: float = WAVINESS) -> np.ndarray:
    """Coherence of two parallel tracks of an isotropic surface: gamma(n) = 2 x^(w/2) K_(w/2)(2 x) / Gamma(w/2).

    x = pi n t with the wave number n [cycles/m] and the distance t [m]; for w = 2 it is 2 pi n t K_1(2 pi n t).

    Source: K. M. A. Kamash and J. D. Robson, "The application of isotropy in road surface modelling", Journal of Sound
    and Vibration 57 (1978), for spectra n^-w.
    """
    x = np.pi * np.asarray(wave_number, float) * track_m
    order = 0.5 * waviness
    with np.errstate(invalid="ignore", over="ignore"):
        value = 2.0 * x**order * kv(order, 2.0 * x) / gamma(order)
    return np.asarray(np.where(x > 1e-9, value, 1.0))


def class_road(
    name: RoadClass, length_m: float, seed: int = 0, *, track_m: float = TRACK_M, waviness: float = WAVINESS
) -> tuple[Stations, np.ndarray]:
    """Stations (n,) from 0 to the length and heights (2, n) of the left and the right track of one road [m].

    Every track is a sum of waves of random phase, z(s) = sum_k sqrt(2 G_d(n_k) dn) cos(2 pi n_k s + theta_k) with
    G_d(n) = G_d(n_0) (n / n_0)^-w in the band 0.011 to 10 cycles/m, so that each has the spectrum of the centre of
    its class.  Their mean m and half their difference d are independent, with G_d (1 + gamma) / 2 and
    G_d (1 - gamma) / 2 (:func:`track_coherence`); tracks are m + d and m - d.

    Parameters
    ----------
    name : class, A to H. length_m : of the road [m]. seed : chooses the road. track_m : distance of the tracks [m].
    waviness : w [-].

    Source: ISO 8608:2016, annexes A and B.
    """
    random = np.random.default_rng([seed, ROAD_CLASSES.index(name)])
    period = max(length_m + _BEYOND_M, 10.0 / BAND[0])
    count = 2 * int(np.ceil(0.5 * period / STATION_STEP_M))
    n = np.fft.rfftfreq(count, STATION_STEP_M)
    inside = (n >= BAND[0]) & (n <= BAND[1])
    density = np.zeros_like(n)
    density[inside] = class_density(name) * (n[inside] / REFERENCE_WAVE_NUMBER) ** -waviness
    alike = track_coherence(n, track_m, waviness)
    parts = []
    for share in (0.5 * (1.0 + alike), 0.5 * (1.0 - alike)):
        phase = random.uniform(0.0, 2.0 * np.pi, n.size)
        amplitude = np.sqrt(2.0 * density * share * n[1])
        parts.append(np.fft.irfft(0.5 * count * amplitude * np.exp(1j * phase), count))
    stations = STATION_STEP_M * np.arange(int(np.ceil(length_m / STATION_STEP_M - 1e-9)) + 1)
    mean, half = (part[: stations.size] for part in parts)
    return stations, np.stack([mean + half, mean - half])


def profile_density(station_m: Stations, height_m: Stations) -> tuple[np.ndarray, np.ndarray]:
    """Wave numbers (m,) [cycles/m] and displacement spectral densities [m3] of a profile in third-octave bands.

    The profile, uniform in station, is freed from its straight line, and its ends are rounded by a cosine taper over a
    tenth of its length; the periodogram is averaged over each band with three or more of its lines.
    """
    step = float(station_m[1] - station_m[0])
    x = station_m - station_m.mean()
    free = height_m - height_m.mean() - x * (x @ height_m) / (x @ x)
    edge = max(free.size // 10, 1)
    taper = np.ones(free.size)
    taper[:edge] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    taper[-edge:] = taper[:edge][::-1]
    spectrum = np.abs(np.fft.rfft(free * taper)) ** 2 * 2.0 * step / (taper**2).sum()
    n = np.fft.rfftfreq(free.size, step)
    edges = BAND[0] * 2.0 ** (np.arange(25) / 3.0)
    label = np.digitize(n, edges) - 1
    kept = [b for b in range(24) if np.count_nonzero(label == b) >= 3 and edges[b + 1] <= 0.25 / step]
    centre = np.array([np.sqrt(edges[b] * edges[b + 1]) for b in kept])
    return centre, np.array([spectrum[label == b].mean() for b in kept])


def class_of_profile(station_m: Stations, height_m: Stations) -> tuple[RoadClass, float] | None:
    """Class of a profile, uniform in station [m], and its density G_d(n_0) [m3] for a waviness of 2.

    G_d(n_0) is the geometric mean of G_d(n) (n / n_0)^2 over the third-octave bands of the profile.  Limits of the
    classes lie half-way, at twice the density of their centres.  None where the profile is too short for a band.

    Source: ISO 8608:2016, table C.1.
    """
    n, density = profile_density(station_m, height_m)
    used = density > 0.0
    if not used.any():
        return None
    value = float(np.exp(np.mean(np.log(density[used] * (n[used] / REFERENCE_WAVE_NUMBER) ** WAVINESS))))
    return class_of_density(value), value


def class_of_density(density_m3: float) -> RoadClass:
    """The class whose centre is nearest to a density G_d(n_0) [m3], in proportion."""
    number = int(np.clip(np.round(np.log(density_m3 / CLASS_A_M3) / np.log(4.0)), 0, len(ROAD_CLASSES) - 1))
    return ROAD_CLASSES[number]


def roughness_index(station_m: Stations, height_m: Stations, *, average_m: float = 0.25) -> float:
    """International Roughness Index of a profile [mm/m]: mean suspension rate of the golden car over its speed.

    The profile is uniform in station and straight between its points.  Where these are nearer than the `average_m` [m]
    it is first averaged over that length (0 for no average).  The car comes from a straight road with the mean slope of
    the first 11 m.

    Source: M. W. Sayers, Transportation Research Record 1501 (1995).
    """
    step = float(station_m[1] - station_m[0])
    height = np.asarray(height_m, float)
    if average_m > step * 1.5:
        width = max(round(average_m / step), 1)
        padded = np.pad(height, (width // 2, width - width // 2), mode="edge")
        area = np.concatenate([[0.0], np.cumsum(padded)])
        height = ((area[width:] - area[:-width]) / width)[: height.size]
    tire, spring, damper, unsprung = GOLDEN_CAR
    # States: heights and rates of the sprung mass and the wheel.
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-spring, -damper, spring, damper],
            [0.0, 0.0, 0.0, 1.0],
            [spring / unsprung, damper / unsprung, -(tire + spring) / unsprung, -damper / unsprung],
        ]
    )
    b = np.array([[0.0], [0.0], [0.0], [tire / unsprung]])
    finer = max(1, int(np.ceil(step / 0.05)))
    interval = step / finer / GOLDEN_SPEED_M_S
    road = np.interp(np.arange((height.size - 1) * finer + 1) / finer, np.arange(height.size), height)
    ad, bd, _, _, _ = cont2discrete((a, b, np.eye(4), np.zeros((4, 1))), interval, method="zoh")
    # Between points the road is straight: what its slope adds.
    first = np.linalg.solve(a, bd) - interval * np.linalg.solve(a, b)
    reach = min(round(11.0 / step), height.size - 1)
    rate = (height[reach] - height[0]) / (reach * step) * GOLDEN_SPEED_M_S
    state = np.array([road[0], rate, road[0], rate])
    slope = np.diff(road) / interval
    poles, shapes = np.linalg.eig(ad)
    inverse = np.linalg.inv(shapes)
    push = inverse @ (bd @ road[None, :-1] + first @ slope[None])
    modes = np.stack(
        [
            lfilter([1.0], [1.0, -p], u, zi=[p * x])[0]
            for p, u, x in zip(poles, push.astype(complex), inverse @ state, strict=True)
        ]
    )
    states = (shapes @ modes).real
    stroke = np.concatenate([[state[0] - state[2]], states[0] - states[2]])
    return float(1e3 * np.abs(np.diff(stroke)).sum() / (station_m[-1] - station_m[0]))
