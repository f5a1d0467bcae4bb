"""Measures of axle loads over a rough road, draw by draw: damage, spectra, range pairs, what repeats along the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rainflow

from sysid.arrays import SamplesByAxlesBySets
from sysid.prediction.measures import quantiles
from sysid.prediction.quantiles import Quantiles

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction

#: Exponent of the damage that axle loads do to a road, where none is given: the fourth power of the AASHO road test.
STRESS_EXPONENT = 4.0
#: Segments of the load spectra [s], which overlap by half, and the highest frequency that is kept [Hz].
_SEGMENT_S, _HIGHEST_HZ = 8.0, 30.0
#: Levels of range pairs as shares of the load at rest. Draws in which ranges are counted, which takes long.
RANGE_LEVELS = np.array([0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0])
RANGE_DRAWS = 20
#: Distance of the stations of aggregate loads [m] on roads of at most so many of them; further apart on longer ones.
_STATION_M, _MOST_STATIONS = 0.25, 40_000


@dataclass(frozen=True)
class Drive:
    """Every draw over every realisation of a road.

    - `forces` (T, na, n): tire forces [N]; `suspension` (T, na, m): of the first m draws [N];
    - `static_N` (na, n): loads at rest; `extremes` (na, n) as :func:`sysid.prediction.measures.extremes` names them.
    """

    forces: SamplesByAxlesBySets
    suspension: SamplesByAxlesBySets
    static_N: np.ndarray
    extremes: dict[str, np.ndarray]


def measures(drives: Sequence[Drive], on_road: np.ndarray, shift: np.ndarray, exponent: float) -> dict[str, np.ndarray]:
    """Measures (axles, n) of some draws over all realisations, and of whole vehicles (1, n).

    Parameters
    ----------
    on_road : (T, na) bool, samples at which an axle is on the road.
    shift : (na,) how many samples later than axle 1 each axle passes a station.
    exponent : of the road stress factors.
    """
    static, q = drives[0].static_N, exponent
    rows: dict[str, list[np.ndarray]] = {
        n: [] for n in ("mean", "spread", "most", "least", "load_95", "load_99", "power")
    }
    for i in range(len(static)):
        force = np.concatenate([d.forces[on_road[:, i], i] for d in drives])
        rows["mean"].append(force.mean(axis=0))
        rows["spread"].append(force.std(axis=0))
        rows["most"].append(force.max(axis=0))
        rows["least"].append(force.min(axis=0))
        high = np.quantile(force, [0.95, 0.99], axis=0)
        rows["load_95"].append(high[0])
        rows["load_99"].append(high[1])
        rows["power"].append(_power(force, q).mean(axis=0))
    found = {name: np.array(values) for name, values in rows.items()}
    at_rest = (static**q).sum(axis=0)
    found["vehicle_stress"] = found["power"].sum(axis=0, keepdims=True) / at_rest
    found["road_stress"] = found.pop("power") / static**q
    together = np.concatenate([_at_one_station(d.forces, shift, q) for d in drives])
    found["aggregate_95"] = np.quantile(together, 0.95, axis=0, keepdims=True) / at_rest
    found["coefficient"] = found.pop("spread") / found["mean"]
    found["mean_ratio"] = found["mean"] / static
    found["sum_ratio"] = found.pop("mean").sum(axis=0, keepdims=True) / static.sum(axis=0)
    for name in drives[0].extremes:
        values = np.stack([d.extremes[name] for d in drives])
        # Time off the road is that of one realisation, the mean of all.
        found[name] = values.mean(axis=0) if name == "lift_off_s" else values.max(axis=0)
    return found


def _at_one_station(forces: np.ndarray, shift: np.ndarray, exponent: float) -> np.ndarray:
    """Sum over the axles of the powers of their forces at every station of the road, (stations, n)."""
    whole = np.floor(shift).astype(int)
    count = len(forces) - int(np.ceil(shift.max())) - 1
    total = np.zeros((count, forces.shape[2]))
    for i, (k, share) in enumerate(zip(whole, shift - whole, strict=True)):
        force = (1.0 - share) * forces[k : k + count, i] + share * forces[k + 1 : k + 1 + count, i]
        total += _power(force, exponent)
    return total


def _power(force: np.ndarray, exponent: float) -> np.ndarray:
    """Force to the exponent; the fourth power by squares, which takes a tenth of the time."""
    return np.square(np.square(force)) if exponent == STRESS_EXPONENT else force**exponent


def aggregate_stations(length_m: float) -> np.ndarray:
    """Stations (m,) [m] of aggregate loads along a road of a length [m]."""
    return np.arange(0.0, length_m, max(_STATION_M, length_m / _MOST_STATIONS))


def aggregate_loads(forces: np.ndarray, shift: np.ndarray, length_m: float, step_m: float) -> np.ndarray:
    """Sum of all axle loads at every station of :func:`aggregate_stations`, (m, n) [N], one axle after the other.

    Parameters
    ----------
    forces : (T, na, n) [N], the first at station 0 of axle 1.
    shift : as in :func:`measures`; length_m, step_m : of the road, and the way of a sample [m].
    """
    along = _at_one_station(forces, shift, 1.0)
    sample = np.minimum(np.round(aggregate_stations(length_m) / step_m).astype(int), len(along) - 1)
    return np.asarray(along[sample], np.float32)


def load_spectra(drives: Sequence[Drive], on_road: np.ndarray, interval_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (m,) [Hz] and one-sided power spectral densities of the axle loads (na, m, n) [N2/Hz].

    The mean over realisations of Welch's estimates: segments of 8 s with a Hann window, which overlap by half, each
    without its mean.

    References
    ----------
    P. D. Welch, IEEE Transactions on Audio and Electroacoustics 15 (1967).
    """
    # Every command that writes tables loads this module, and SciPy's signals take longer to load than all of it.
    from scipy.signal import welch

    rows = []
    for i in range(on_road.shape[1]):
        each = []
        for d in drives:
            force = d.forces[on_road[:, i], i]
            count = min(round(_SEGMENT_S / interval_s), len(force))
            frequency, density = welch(force, 1.0 / interval_s, nperseg=count, axis=0)
            each.append(density)
        rows.append(np.mean(each, axis=0))
    shortest = min(len(row) for row in rows)
    kept = frequency[:shortest] <= _HIGHEST_HZ
    return frequency[:shortest][kept], np.stack([row[:shortest][kept] for row in rows])


def range_pairs(force_N: np.ndarray, static_N: float, length_m: float) -> np.ndarray:
    """How often per kilometre the load goes to and fro by more than each of :data:`RANGE_LEVELS`, (k,).

    Rainflow counting of ASTM E1049-85, section 5.4.4: half cycles count one half.

    Parameters
    ----------
    force_N : (T,) history; static_N : load at rest, to which the levels refer; length_m : of the road.
    """
    turns = np.sign(np.diff(force_N))
    # Only turning points are handed over, which is what takes the time.
    ends = np.flatnonzero(turns[1:] != turns[:-1]) + 1
    points = force_N[np.concatenate([[0], ends, [force_N.size - 1]])]
    cycles = list(rainflow.extract_cycles(points.tolist()))
    ranges, counts = (np.array([cycle[k] for cycle in cycles], float) for k in (0, 2))
    exceeded = ranges[:, None] > RANGE_LEVELS * static_N
    return np.asarray((counts[:, None] * exceeded).sum(axis=0) * 1e3 / length_m)


def counted_ranges(drive: Drive, on_road: np.ndarray, length_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Range pairs per kilometre of tire and of suspension forces of the first draws, (na, k, m) each."""
    axles, count = drive.suspension.shape[1:]
    found = np.empty((2, axles, RANGE_LEVELS.size, count))
    for counts, forces in zip(found, (drive.forces, drive.suspension), strict=True):
        for i in range(axles):
            for j in range(count):
                static = float(drive.static_N[i, j])
                counts[i, :, j] = range_pairs(forces[on_road[:, i], i, j], static, length_m)
    return found[0], found[1]


def repeatability(one_N: np.ndarray, other_N: np.ndarray) -> Quantiles:
    """Spatial repeatability of aggregate loads (m, n) of two passes over one road, quantiles (1,) over their n draws.

    It is the correlation coefficient of both along the road, 1 where both load the same places most.

    References
    ----------
    OECD, Dynamic Interaction between Vehicles and Infrastructure Experiment (DIVINE), 1998;
    D. J. Cole, A. C. Collop, T. E. C. Potter, D. Cebon, Proc. IMechE D 210 (1996), 185-197.
    """
    a, b = (x - x.mean(axis=0) for x in (np.asarray(one_N, float), np.asarray(other_N, float)))
    size = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    found = np.divide((a * b).sum(axis=0), size, out=np.zeros(size.shape), where=size > 0.0)
    return quantiles(found[None])


def passes_of_one_road(passes: Sequence[PassPrediction]) -> list[tuple[PassPrediction, PassPrediction]]:
    """Every two passes over one road, the same pass twice among them; draws of both are those of one vehicle."""
    over = [p for p in passes if p.road is not None]
    return [
        (a, b)
        for i, a in enumerate(over)
        for b in over[i:]
        if a.road is not None and b.road is not None
        if (a.shape, a.road.length_m) == (b.shape, b.road.length_m)
    ]
