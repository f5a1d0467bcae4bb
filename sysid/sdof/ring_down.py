"""Motion of one mass on a spring with viscous, dry and quadratic damping, from swing to swing until it sticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_STEPS = 22  # of a swing: errors below 1e-5 of the amplitude
_NODES = 9  # amplitudes from which a swing's end and duration are interpolated: errors below 1e-6
_REACH = 1.3  # half periods that are integrated of each swing; its turning point lies before that


@dataclass(frozen=True)
class RingDown:
    """A computed ring-down, one row per parameter set.

    - `value` (p, n) [m] at the times asked for;
    - `turn_s`, `turn_m` (p, swings): time and place of the turning points, NaN after the last;
    - `stick_s` (p,) when the mass sticks, infinite where it does not within the record.
    """

    value: np.ndarray
    turn_s: np.ndarray
    turn_m: np.ndarray
    stick_s: np.ndarray


def ring_down(parameters: np.ndarray, time_s: np.ndarray, direction: float) -> RingDown:
    """Motion after a moment of known position and velocity, for several parameter sets at once.

    x'' + 2 beta x' + q |x'| x' + f omega^2 sign(x') + omega^2 y (1 + e y^2) = 0 with y = x - x0; the mass sticks at the
    turning point where |y| (1 + e y^2) <= f.  Every swing is integrated apart (classical Runge-Kutta, turning points by
    a cubic between the steps), because the friction's sign holds for one swing.

    Parameters
    ----------
    parameters
        (p, 8): omega [rad/s], x0 [m], position [m] and velocity [m/s] at the first time, beta [1/s], f = F/k [m],
        q [1/m], e [1/m^2].
    time_s
        (n,) increasing times [s]; position and velocity are those at the first.
    direction
        Sign of the velocity at the first time, the same in all sets.
    """
    omega, centre, position, x_rate, beta, friction, quadratic, cubic = np.asarray(parameters, float).T
    end = float(time_s[-1] - time_s[0])
    half = np.pi / np.sqrt(np.maximum(omega**2 - beta**2, 0.04 * omega**2))
    law = _Law(omega**2, 2.0 * beta, friction, quadratic, cubic, half * (_REACH / _STEPS))
    first, swing_from = _first_swings(law, position - centre, x_rate, direction)
    # Swings are shorter than the half period where the spring stiffens: twice as many leave room.
    chain = _chain(law, first, swing_from, end, int(2.0 * end / float(half.min())) + 3)
    at, rate = _swings(law, chain.place, np.zeros_like(chain.place), chain.sign)
    at, rate = np.where(chain.stuck, chain.place, at), np.where(chain.stuck, 0.0, rate)
    at, rate = (np.concatenate([a[:, :, :1], b], axis=2) for a, b in ((first.at, at), (first.rate, rate)))
    begins = np.concatenate([np.zeros((omega.size, 1)), chain.begin], axis=1)
    value = _at_times(begins, at, rate, law.step, time_s - time_s[0])
    inside = begins[:, 1:] <= end
    return RingDown(
        value + centre[:, None],
        np.where(inside, begins[:, 1:] + time_s[0], np.nan),
        np.where(inside, chain.place + centre[:, None], np.nan),
        np.where(chain.stick <= end, chain.stick + time_s[0], np.inf),
    )


@dataclass(frozen=True)
class _Law:
    """Coefficients (p,) of the equation: omega^2, 2 beta, f, q, e; and the time step of a swing [s]."""

    square: np.ndarray
    twice_beta: np.ndarray
    friction: np.ndarray
    quadratic: np.ndarray
    cubic: np.ndarray
    step: np.ndarray

    @property
    def sticks_within(self) -> np.ndarray:
        """Where the spring force is that of the friction (p,) [m], by Newton's method."""
        place = self.friction
        for _ in range(4):
            bend = np.maximum(1.0 + 3.0 * self.cubic * place**2, 0.05)
            place = np.maximum(place - (place * (1.0 + self.cubic * place**2) - self.friction) / bend, 0.0)
        return np.asarray(place)


@dataclass(frozen=True)
class _FirstSwing:
    """The swing under way at the first time, as `_swings` gives it: its end (p,) [s], [m] and which way it went."""

    at: np.ndarray
    rate: np.ndarray
    length: np.ndarray
    place: np.ndarray
    sign: float


@dataclass(frozen=True)
class _SwingFrom:
    """Swings from rest at `nearest` + a, 0 < a < `width` [m]: polynomials (m, 2, p) of 2 a / `width` - 1.

    They give (end + nearest) / a, with the end counted on the other side, and the duration [s]: both are constant
    where there is no quadratic damping and no stiffening.
    """

    nearest: np.ndarray
    width: np.ndarray
    coefficients: np.ndarray

    def __call__(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place of the next turning point on the other side and time until then, (p,) each."""
        above = np.maximum(place - self.nearest, 0.0)
        u = 2.0 * above / self.width - 1.0
        value = self.coefficients[-1]
        for coefficient in self.coefficients[-2::-1]:
            value = value * u + coefficient
        return value[0] * above - self.nearest, value[1]


@dataclass(frozen=True)
class _Chain:
    """Swings after the first: when and where each begins (p, swings), its sign (swings,), and whether it is at rest."""

    begin: np.ndarray
    place: np.ndarray
    sign: np.ndarray
    stuck: np.ndarray
    stick: np.ndarray


def _first_swings(law: _Law, x: np.ndarray, v: np.ndarray, direction: float) -> tuple[_FirstSwing, _SwingFrom]:
    """The first swing, and those from rest at Chebyshev nodes up to the amplitude that its energy allows."""
    energy = x**2 + v**2 / law.square + 0.5 * law.cubic * x**4
    largest = np.sqrt(2.0 * energy / (1.0 + np.sqrt(np.maximum(1.0 + 2.0 * law.cubic * energy, 0.04))))
    nearest = law.sticks_within
    width = np.maximum(largest - nearest, 1e-6 * largest + 1e-12)
    above = 0.5 * width[:, None] * (1.0 + _NODE_PLACES)
    sign = np.concatenate([[float(np.sign(direction))], np.full(_NODES, -1.0)])
    starts = np.concatenate([x[:, None], nearest[:, None] + above], axis=1)
    rates = np.concatenate([v[:, None], np.zeros_like(above)], axis=1)
    at, rate = _swings(law, starts, rates, sign)
    length, place = _turning_points(at, rate, law.step[:, None], sign)
    seen = np.stack([(nearest[:, None] - place[:, 1:]) / above, length[:, 1:]])
    coefficients = np.einsum("mk,cpk->mcp", _TO_POLYNOMIAL, seen)
    first = _FirstSwing(at, rate, length[:, 0], place[:, 0], float(sign[0]))
    return first, _SwingFrom(nearest, width, coefficients)


def _chain(law: _Law, first: _FirstSwing, swing_from: _SwingFrom, end: float, most: int) -> _Chain:
    """All later swings, one after the other, until they have stuck or the record is over."""
    begin, x, sign = first.length, first.place, -first.sign
    stick = np.full(begin.size, np.inf)
    begins, places, signs, stucks = [], [], [], []
    for _ in range(most):
        held = np.isfinite(stick)
        stops = ~held & (np.abs(x) * (1.0 + law.cubic * x**2) <= law.friction)
        stick = np.where(stops, begin, stick)
        # A mass at rest has one swing that stays, and none after that.
        begin = np.where(held, np.inf, begin)
        begins.append(begin)
        places.append(x)
        signs.append(sign)
        stucks.append(held | stops)
        if np.all(begin > end):
            break
        to, length = swing_from(-sign * x)
        x, begin, sign = np.where(held | stops, x, sign * to), begin + length, -sign
    columns = (np.stack(c, axis=1) for c in (begins, places, stucks))
    return _Chain(*(next(columns), next(columns), np.array(signs), next(columns)), stick)


def _swings(law: _Law, x: np.ndarray, v: np.ndarray, sign: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (steps + 1, p, s) of swings (p, s); the law of their direction (s,) goes on beyond."""
    square, twice_beta, cubic, step = (c[:, None] for c in (law.square, law.twice_beta, law.cubic, law.step))
    shift, drag = sign * (law.friction * law.square)[:, None], sign * law.quadratic[:, None]

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.asarray(-(twice_beta + drag * v) * v - square * x * (1.0 + cubic * x * x) - shift)

    positions, rates = np.empty((2, _STEPS + 1, *x.shape))
    positions[0], rates[0] = x, v
    for k in range(_STEPS):
        a1 = acceleration(x, v)
        v2 = v + 0.5 * step * a1
        a2 = acceleration(x + 0.5 * step * v, v2)
        v3 = v + 0.5 * step * a2
        a3 = acceleration(x + 0.5 * step * v2, v3)
        v4 = v + step * a3
        a4 = acceleration(x + step * v3, v4)
        x, v = x + step / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + step / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        positions[k + 1], rates[k + 1] = x, v
    return positions, rates


def _turning_points(
    at: np.ndarray, rate: np.ndarray, step: np.ndarray, sign: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Time from the start of each swing (p, s) to its turning point, and its place; the end where there is none."""
    passed = sign * rate[1:] < 0.0
    k = np.where(passed.any(axis=0), np.argmax(passed, axis=0), _STEPS - 1)[None]
    x0, x1, v0, v1 = (np.take_along_axis(values, index, axis=0)[0] for values in (at, rate) for index in (k, k + 1))
    v0, v1 = v0 * step, v1 * step
    # The cubic through places and velocities of both ends: its slope v0 + 2 b u + 3 c u^2 vanishes at u.
    c = 2.0 * (x0 - x1) + v0 + v1
    b = 3.0 * (x1 - x0) - 2.0 * v0 - v1
    u = np.clip(np.where(v0 != v1, v0 / np.where(v0 == v1, 1.0, v0 - v1), 0.0), 0.0, 1.0)
    for _ in range(3):
        bend = 2.0 * b + 6.0 * c * u
        u = np.clip(u - (v0 + (2.0 * b + 3.0 * c * u) * u) / np.where(bend == 0.0, 1.0, bend), 0.0, 1.0)
    return (k[0] + u) * step, x0 + (v0 + (b + c * u) * u) * u


def _at_times(
    begins: np.ndarray, positions: np.ndarray, rates: np.ndarray, step: np.ndarray, time: np.ndarray
) -> np.ndarray:
    """Places (p, n) at times from the start, by the cubic through places and velocities of the steps."""
    swing = np.stack([np.searchsorted(row[1:], time, "right") for row in begins])
    row = np.arange(step.size)[:, None]
    u = (time - begins[row, swing]) / step[:, None]
    k = np.minimum(u.astype(int), _STEPS - 1)
    u = np.minimum(u - k, 1.0)
    x0, x1 = positions[k, row, swing], positions[k + 1, row, swing]
    v0, v1 = rates[k, row, swing] * step[:, None], rates[k + 1, row, swing] * step[:, None]
    c, b = 2.0 * (x0 - x1) + v0 + v1, 3.0 * (x1 - x0) - 2.0 * v0 - v1
    return np.asarray(x0 + (v0 + (b + c * u) * u) * u)


#: Chebyshev nodes, and from values at them (m,) the coefficients of the polynomial through them.
_NODE_PLACES = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
_TO_POLYNOMIAL = np.linalg.inv(np.vander(_NODE_PLACES, increasing=True))
