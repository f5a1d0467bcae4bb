"""Gains, lags and leaks of the sensors of one axle, and places of frame sensors, from all runs together.

The frame above an axle moves with the acceleration b = a + q'': deflection q, axle acceleration a and frame
acceleration b of one axle hold one redundant equation at every frequency.  One wrong sensor breaks it in its own way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.campaign.gaps import Window, readings_at, window_over
from sysid.campaign.quality.exchanges import quoted
from sysid.campaign.quality.sensor_trios import Trio, trios
from sysid.campaign.records import BumpRun, Channel, Sensor
from sysid.campaign.vehicle_records import Vehicle
from sysid.numbers import listing

#: Below, drift; above, the deflection's noise, differentiated twice, is larger than the motion.
BAND_HZ = (1.0, 12.0)
#: Gains and lags beyond these are said; sensors mounted with care are within them.
GAIN_OFF, LAG_S, LEAK = 0.06, 0.0035, 0.1
#: A fault must explain this share of what the three sensors disagree by, and be clearer than another sensor's.
EXPLAINED, CLEARER = 0.3, 0.75
#: Corners of a high-pass filter that a deflection may have gone through (AC coupling) [Hz].
CORNERS_HZ = (0.1, 0.16, 0.25, 0.4, 0.6, 1.0, 1.6, 2.5)
LAGS_S, FINE_S = np.arange(-0.15, 0.1501, 0.005), np.arange(-0.005, 0.0051, 0.001)
#: Shares of a run that three sensors must have seen together, and each of many.
SEEN, SEEN_BY_ALL = 0.7, 0.97
#: Frames turn here; above, they bend.
FRAME_BAND_HZ = (0.8, 5.0)
#: Frame sensors are found at their place within 0.3 m.
#: Frame sensors whose places are looked for one after the other.
MOST_PLACES = 3
#: Other places explain a disagreement if they leave no more than this share of it.
PLACE_M, LEFT = 0.6, 0.4
#: Where the frame above the axles says the places, it says the motion there too, but for this share of its power.
ALIKE = 0.1


@dataclass(frozen=True)
class Equation:
    """Spectra of the three sensors of one axle in one run, divided by w: of q'', -a and b, with q'' = b - a."""

    omega: np.ndarray
    parts: tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class SensorFault:
    """One sensor of an axle that contradicts the two others: a sentence, and its lag [s]."""

    axle: int
    said: str
    lag_s: float = 0.0


def sensor_complaints(runs: Sequence[BumpRun], vehicle: Vehicle) -> list[SensorFault]:
    """Sensors whose gain, clock or wiring is not that of the others of their axle."""
    equations: dict[int, list[Equation]] = {}
    sensors: dict[int, tuple[Sensor, ...]] = {}
    leaks: dict[int, list[dict[str, np.ndarray]]] = {}
    for run in runs:
        record = _Record(run)
        for trio in trios(run.log.channels, vehicle):
            made = _equation(trio, record)
            if made is None:
                continue
            equation, window, omega = made
            equations.setdefault(trio.axle, []).append(equation)
            sensors[trio.axle] = tuple(c.sensor for c in trio.channels)
            leaks.setdefault(trio.axle, []).append(_others(trio, record, window, omega))
    faults = (_fault(axle, equations[axle], sensors[axle], leaks[axle]) for axle in sorted(equations))
    return [fault for fault in faults if fault is not None]


class _Record:
    """One run on even times; a channel stands beside every axle, so that its spectrum is kept."""

    def __init__(self, run: BumpRun) -> None:
        self.channels = run.log.channels
        self.step_s = run.log.sample_interval_s
        steps = run.log.duration_s / self.step_s
        self.time_s = self.step_s * np.arange(int(steps) + 1 if steps <= limits.GRID_STEPS else 0)
        self._readings: dict[str, np.ndarray] = {}
        self._windows: dict[bytes, Window | None] = {}
        self._spectra: dict[tuple[str, int], np.ndarray] = {}

    def readings(self, channel: Channel) -> np.ndarray:
        """Readings of a channel at even times, NaN in gaps and where they clip."""
        column = channel.sensor.column
        if column not in self._readings:
            self._readings[column] = readings_at(channel, self.time_s, BAND_HZ[1], clipped=False)
        return self._readings[column]

    def window(self, channels: Sequence[Channel]) -> Window | None:
        """The window over what all channels have seen; None where that is less than most of the record."""
        readings = [self.readings(c) for c in channels]
        # Channels of one clock without gaps share their window, and so their spectra.
        key = np.packbits(np.logical_and.reduce([np.isfinite(r) for r in readings])).tobytes()
        if key not in self._windows:
            window = window_over(self.time_s, readings)
            enough = window is not None and window.known_s > SEEN * self.time_s.size * self.step_s
            self._windows[key] = window if enough else None
        return self._windows[key]

    def omega(self, low_hz: float, high_hz: float) -> np.ndarray:
        """Angular frequencies of the spectra between two frequencies [rad/s]."""
        frequency = np.fft.rfftfreq(self.time_s.size, self.step_s)
        return 2.0 * np.pi * frequency[(frequency >= low_hz) & (frequency <= min(high_hz, 0.4 / self.step_s))]

    def acceleration(self, channel: Channel, window: Window, omega: np.ndarray) -> np.ndarray:
        """Spectrum of a channel under a window, a deflection derived twice."""
        key = channel.sensor.column, id(window)
        if key not in self._spectra:
            derivative = 2 * (channel.sensor.kind == "suspension_deflection")
            self._spectra[key] = window.transform(self.readings(channel), omega, derivative)
        return self._spectra[key]


def _equation(trio: Trio, record: _Record) -> tuple[Equation, Window, np.ndarray] | None:
    """The equation of one axle in one run, its window and frequencies; None where a sensor clips or lacks readings."""
    if trio.body_acceleration is None or any(c.censored.any() for c in trio.channels) or record.time_s.size < 2:
        return None
    window, omega = record.window(trio.channels), record.omega(*BAND_HZ)
    if window is None or omega.size < 20:
        return None
    q, a, b = (record.acceleration(c, window, omega) / omega for c in trio.channels)
    return Equation(omega, (q, -a, b)), window, omega


def _others(trio: Trio, record: _Record, window: Window, omega: np.ndarray) -> dict[str, np.ndarray]:
    """Spectra of the sensors of the same kinds at other axles, divided by w, where they have seen the same."""
    compared = {c.sensor.column for c in trio.channels}
    used = window.weight > 0.0
    return {
        f"{c.sensor.kind} {c.sensor.column}": record.acceleration(c, window, omega) / omega
        for c in record.channels
        if c.sensor.column not in compared and bool(np.isfinite(record.readings(c)[used]).all())
    }


@dataclass(frozen=True)
class _Explanation:
    sensor: int
    rest: float
    gain: float
    lag_s: float
    leak: float = 0.0
    source: str = ""
    corner_hz: float = 0.0


def _fault(
    axle: int, equations: Sequence[Equation], sensors: Sequence[Sensor], others: Sequence[dict[str, np.ndarray]]
) -> SensorFault | None:
    right = sum(_power(e.parts[0] - e.parts[1] - e.parts[2]) for e in equations)
    tried = [_one_wrong(equations, k) for k in range(3)]
    tried.append(_high_passed(equations))
    tried += [leak for k in range(3) for leak in _leaks(equations, k, sensors[k].kind, others)]
    tried.sort(key=lambda t: t.rest)
    best = tried[0]
    plain = min((t for t in tried if not t.source), key=lambda t: t.rest)
    # A leak is the less simple explanation.
    if best.source and plain.rest < 2.0 * best.rest:
        best = plain
    if best.rest > (1.0 - EXPLAINED) * right or best.rest > 0.3 * sum(_power(e.parts[0]) for e in equations):
        return None
    rival = min((t.rest for t in tried if t.sensor != best.sensor), default=np.inf)
    doubt = "" if best.rest < CLEARER * rival else " (or another sensor of this axle is wrong)"
    name = quoted(sensors[best.sensor])
    if best.source:
        return SensorFault(
            axle,
            f"{name} contains about {100 * best.leak:.0f} % of '{best.source}' (crosstalk){doubt}; check cable, "
            "connector and amplifier, or remove the sensor.",
        )
    if best.corner_hz:
        return SensorFault(
            axle,
            f"{name} lacks what is slower than about {best.corner_hz:.1g} Hz, as behind a high-pass filter (AC "
            f"coupling){doubt}; record it with DC coupling.",
        )
    if abs(best.lag_s) > LAG_S:
        word = "late" if best.lag_s > 0.0 else "early"
        also = f", and reads {best.gain:.2f} times what they imply" if abs(best.gain - 1.0) > GAIN_OFF else ""
        return SensorFault(
            axle,
            f"{name} is {1e3 * abs(best.lag_s):.0f} ms {word} against the other sensors of its axle{also}{doubt}: "
            "another filter, amplifier or logger; correct its time.",
            best.lag_s,
        )
    if abs(best.gain - 1.0) > GAIN_OFF:
        return SensorFault(
            axle,
            f"{name} reads {best.gain:.2f} times what the other sensors of its axle imply{doubt}; check its "
            f"calibration, or set scale = {1.0 / best.gain:.3f} for it in campaign.toml.",
        )
    return None


def _power(spectrum: np.ndarray) -> float:
    return float(np.sum(np.abs(spectrum) ** 2))


def _one_wrong(equations: Sequence[Equation], wrong: int) -> _Explanation:
    """The gain and lag of one sensor, the others right, that leave the least."""
    coarse = _best_lag(equations, wrong, LAGS_S)
    return _best_lag(equations, wrong, coarse.lag_s + FINE_S)


def _best_lag(equations: Sequence[Equation], wrong: int, lags_s: np.ndarray) -> _Explanation:
    # The wrong part, divided by gain and shifted back, is what the other two imply; a shift leaves powers as they are.
    rests = [_implied(e, wrong) for e in equations]
    bottom, whole = sum(_power(e.parts[wrong]) for e in equations), sum(map(_power, rests))
    top = np.zeros(lags_s.size)
    for e, rest in zip(equations, rests, strict=True):
        top += np.real(np.exp(-1j * np.outer(lags_s, e.omega)) @ (np.conj(e.parts[wrong]) * rest))
    inverse = top / max(bottom, 1e-30)
    left = np.where(inverse > 0.0, whole - top * inverse, np.inf)
    k = int(np.argmin(left))
    if not inverse[k] > 0.0:
        return _Explanation(wrong, np.inf, 1.0, 0.0)
    return _Explanation(wrong, float(left[k]), 1.0 / float(inverse[k]), float(lags_s[k]))


def _high_passed(equations: Sequence[Equation]) -> _Explanation:
    """The deflection behind a high-pass filter of first order, i w / (i w + w_c), turned back."""
    best = _Explanation(0, np.inf, 1.0, 0.0)
    for corner in CORNERS_HZ:
        rest = sum(_power(e.parts[0] * (1.0 - 2j * np.pi * corner / e.omega) - _implied(e, 0)) for e in equations)
        if rest < best.rest:
            best = _Explanation(0, rest, 1.0, 0.0, corner_hz=corner)
    return best


def _implied(e: Equation, wrong: int) -> np.ndarray:
    q, a, b = e.parts
    return np.asarray((a + b, q - b, q - a)[wrong])


def _leaks(
    equations: Sequence[Equation], wrong: int, kind: str, others: Sequence[dict[str, np.ndarray]]
) -> list[_Explanation]:
    """One sensor that holds a share of another one of its kind besides its own reading."""
    names = set.intersection(*(set(o) for o in others)) if others else set()
    explanations = []
    for name in sorted(n for n in names if n.startswith(kind)):
        top = bottom = whole = 0.0
        for e, spectra in zip(equations, others, strict=True):
            shape = spectra[name] * (-1.0 if wrong == 1 else 1.0)
            rest = e.parts[wrong] - _implied(e, wrong)
            top += float(np.real(np.vdot(shape, rest)))
            bottom += _power(shape)
            whole += _power(rest)
        share = top / max(bottom, 1e-30)
        if share > LEAK:
            explanations.append(_Explanation(wrong, whole - top * share, 1.0, 0.0, share, name.split(" ", 1)[1]))
    return explanations


def place_of_frame_sensors(runs: Sequence[BumpRun], vehicle: Vehicle) -> list[str]:
    """Sentences about frame sensors that move as another place of the frame does: x_m, or exchanged.

    One wrong place disturbs what the others imply for each other.  That sensor is named whose move explains most of
    what all leave; then the same is looked for with it at its place.
    """
    spectra = [found for run in runs if (found := _frame_spectra(run, vehicle)) is not None]
    listed = {c.sensor.column: c.sensor for run in runs for c in run.log.channels}
    if several := _several_places(spectra, listed):
        return several
    moved: dict[str, float] = {}
    said = []
    for _ in range(MOST_PLACES):
        sums = _place_sums(spectra, moved)
        before = sum(left for _, _, left in sums.values())
        offs = {c: cross / max(size, 1e-30) for c, (cross, size, _) in sums.items() if c not in moved}
        tried = {
            c: sum(left for _, _, left in _place_sums(spectra, moved | {c: off}).values())
            for c, off in offs.items()
            if abs(off) > PLACE_M
        }
        best = min(tried, key=lambda c: tried[c], default=None)
        if best is None or tried[best] > LEFT * before:
            break
        sensor, moved[best] = listed[best], offs[best]
        assert sensor.x_m is not None
        said.append(
            f"{quoted(sensor)} moves as the frame does at x_m = {sensor.x_m + moved[best]:.1f} m, not at the listed "
            f"{sensor.x_m:g} m; correct its x_m in campaign.toml, or check which sensor this column holds."
        )
    return said


def _several_places(spectra: Sequence[_FrameSpectra], listed: Mapping[str, Sensor]) -> list[str]:
    """The same of several frame sensors at once, against the frame above the axles alone: none of them is a witness."""
    sums = _place_sums(spectra, {}, axles_alone=True)
    moved = {c: cross / max(size, 1e-30) for c, (cross, size, _) in sums.items()}
    after = {c: left for c, (_, _, left) in _place_sums(spectra, moved, axles_alone=True).items()}
    off = [c for c in moved if abs(moved[c]) > PLACE_M and after[c] < LEFT * sums[c][2]]
    if len(off) < 2 or max(after.values()) > ALIKE * len(spectra):
        return []
    places = [(quoted(listed[c]), f"{(listed[c].x_m or 0.0) + moved[c]:.1f}", f"{listed[c].x_m:.3g}") for c in off]
    names, found, declared = (listing(list(words)) for words in zip(*places, strict=True))
    return [
        f"{names} move as the frame does at x_m = {found} m, not at the listed {declared} m; correct their x_m in "
        "campaign.toml (m behind the front axle)."
    ]


def _seen(channel: Channel, record: _Record) -> bool:
    """Whether a channel does not clip, and has seen nearly all of a run, so that it takes little from the others."""
    return not channel.censored.any() and bool(np.isfinite(record.readings(channel)).mean() > SEEN_BY_ALL)


@dataclass(frozen=True)
class _FrameSpectra:
    """Spectra of one run: of frame sensors by column, with their bodies and places, and of the frame above axles."""

    sensors: dict[str, tuple[int, float, np.ndarray]]
    above: list[tuple[int, float, np.ndarray]]


def _frame_spectra(run: BumpRun, vehicle: Vehicle) -> _FrameSpectra | None:
    record = _Record(run)
    if record.time_s.size < 2:
        return None
    omega = record.omega(*FRAME_BAND_HZ)
    frames = [
        c
        for c in run.log.channels
        if c.sensor.kind == "body_acceleration" and c.sensor.x_m is not None and _seen(c, record)
    ]
    whole = [t for t in trios(run.log.channels, vehicle)
             if _seen(t.axle_acceleration, record) and _seen(t.deflection, record)]  # fmt: skip
    compared = [*frames, *(c for t in whole for c in (t.axle_acceleration, t.deflection))]
    window = record.window(compared) if compared else None
    if window is None or omega.size < 10:
        return None
    above = []
    for trio in whole:
        axle = vehicle.axles[trio.axle]
        a, q = (record.acceleration(c, window, omega) for c in (trio.axle_acceleration, trio.deflection))
        above.append((axle.body, axle.x_m, a + q))
    return _FrameSpectra(
        {
            c.sensor.column: (
                int(c.sensor.body or 0),
                float(c.sensor.x_m or 0.0),
                record.acceleration(c, window, omega),
            )
            for c in frames
        },
        above,
    )


def _place_sums(
    spectra: Sequence[_FrameSpectra], moved: Mapping[str, float], *, axles_alone: bool = False
) -> dict[str, tuple[float, float, float]]:
    """Sums over the runs of how far [m] each frame sensor is from its place: top, bottom, and what is left before.

    Parameters
    ----------
    moved
        Distances [m] by which sensors are taken to be behind their listed places.
    axles_alone
        Whether the frame above the axles is compared with, and no other frame sensor.
    """
    result: dict[str, tuple[float, float, float]] = {}
    for run in spectra:
        places = {c: (body, x + moved.get(c, 0.0), s) for c, (body, x, s) in run.sensors.items()}
        for column, (body, here, motion_here) in places.items():
            points = [(x, s) for b, x, s in run.above if b == body]
            points += [(x, s) for c, (b, x, s) in places.items() if c != column and b == body and not axles_alone]
            x = np.array([p[0] for p in points])
            if x.size < (2 if axles_alone else 4) or np.ptp(x) < 1.0:
                continue
            design = np.stack([np.ones(x.size), -(x - x.mean())], axis=1)
            motion = np.linalg.lstsq(design, np.array([p[1] for p in points]), rcond=None)[0]
            rest = motion_here - (motion[0] - (here - x.mean()) * motion[1])
            slope = -motion[1]
            scale = 1.0 / max(_power(motion_here), 1e-30)
            top, bottom, left = result.get(column, (0.0, 0.0, 0.0))
            result[column] = (
                top + scale * float(np.real(np.vdot(slope, rest))),
                bottom + scale * _power(slope),
                left + scale * _power(rest),
            )
    return result
