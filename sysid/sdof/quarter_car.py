"""Motion of a quarter car after its drop: suspension with friction and curved laws, tire that never pulls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.special import wrightomega

from sysid.campaign.units import STANDARD_GRAVITY_M_S2

#: Longest step [s]. The linear part is exact at any step; over this one, friction and curved springs err by less than
#: 0.1 mm.
LONGEST_STEP_S = 0.0051


@dataclass(frozen=True)
class QuarterCars:
    """Several quarter cars (p,) each at once, SI units; y is the extension of the suspension from rest.

    - `mass`, `unsprung`, `tire`, `tire_damping`;
    - `stiffness`, `bend` [1/m], `cubic` [1/m^2]: spring force k y (1 + b y + e y^2);
    - `damping`, `asymmetry` [-], `quadratic` [N s^2/m^2]: damper force c v (1 + a sign v) + Q |v| v;
    - `friction` [N], `slip` [m]: Dahl's friction F z, dz/dy = (1 - z sign v) / slip;
    - `start` (4, p): y [m], its rate, height of the wheel from rest [m], its rate; `stuck` (p,): z at the start.
    """

    mass: np.ndarray
    unsprung: np.ndarray
    tire: np.ndarray
    tire_damping: np.ndarray
    stiffness: np.ndarray
    bend: np.ndarray
    cubic: np.ndarray
    damping: np.ndarray
    asymmetry: np.ndarray
    quadratic: np.ndarray
    friction: np.ndarray
    slip: np.ndarray
    start: np.ndarray
    stuck: np.ndarray

    def extension(self, time_s: np.ndarray) -> np.ndarray:
        """Extension y (p, n) [m] at increasing times (n,) [s]; the start is at the first.

        m (y'' + w'') = -f,  mu w'' = f - min(kt w + ct w', (m + mu) g)

        f = k y (1 + b y + e y^2) + c y' (1 + a sign y') + Q |y'| y' + F z

        The linear part is solved exactly for forces that are linear over a step (matrix exponential), the others by one
        correction of a prediction. Friction and the move that it allows are solved together, at any slip length.
        """
        end = float(time_s[-1] - time_s[0])
        steps = max(int(np.ceil(end / LONGEST_STEP_S)), 1)
        step = end / steps
        carried = (self.mass + self.unsprung) * STANDARD_GRAVITY_M_S2
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            # Of a search that runs away nothing is left but numbers that are not finite; log(0) is of cars without
            # friction.
            states = self._march(step, steps, None)
            lifted = np.any(self.tire * states[:, 2] + self.tire_damping * states[:, 3] > carried, axis=0)
            if lifted.any():
                states[:, :, lifted] = self._some(lifted)._march(step, steps, carried[lifted])
            at = (time_s - time_s[0]) / step
            k = np.minimum(at.astype(int), steps - 1)
            u = at - k
            # Cubic through places and rates at both ends of a step.
            x0, x1, v0, v1 = states[k, 0].T, states[k + 1, 0].T, step * states[k, 1].T, step * states[k + 1, 1].T
            c, b = 2.0 * (x0 - x1) + v0 + v1, 3.0 * (x1 - x0) - 2.0 * v0 - v1
            return np.asarray(x0 + (v0 + (b + c * u) * u) * u)

    def _some(self, chosen: np.ndarray) -> QuarterCars:
        return QuarterCars(**{name: getattr(self, name)[..., chosen] for name in self.__dataclass_fields__})

    def _march(self, step: float, steps: int, carried: np.ndarray | None) -> np.ndarray:
        """States (steps + 1, 4, p) at every step; tires lift off where the load `carried` (p,) [N] is given."""
        phi, before, after = self._transition(step)
        both = before + after
        bent, cubed = self.stiffness * self.bend, self.stiffness * self.cubic
        one_sided = self.damping * self.asymmetry
        curved, rubs = bool(np.any(bent) or np.any(cubed)), bool(np.any(self.friction))
        # Of friction that sticks, h^2 F / slip / m. Where it is large, the friction at the end of a step acts during
        # all of it, which does not oscillate.
        stiff = step**2 * self.friction / self.slip * (1.0 / self.mass + 1.0 / self.unsprung)
        rubbing = self.friction * (after[:, 0] + stiff * both[:, 0]) / (1.0 + stiff)
        per_slip = 1.0 / self.slip
        held = np.maximum(-rubbing[0] * per_slip, 1e-300)

        def forces(s: np.ndarray) -> list[np.ndarray]:
            """Of the suspension beyond the linear one, and of the road beyond the linear tire [N], (p,) each."""
            y, v = s[0], s[1]
            force = (one_sided + self.quadratic * v) * np.abs(v)
            if curved:
                force += (bent + cubed * y) * y * y
            if carried is None:
                return [force]
            return [force, np.maximum(self.tire * s[2] + self.tire_damping * s[3] - carried, 0.0)]

        states = np.empty((steps + 1, 4, self.mass.size))
        states[0] = self.start
        s, z = self.start, self.stuck
        now = forces(s)
        for n in range(steps):
            ahead = np.add.reduce(phi * s, axis=1)
            for i, force in enumerate(now):
                ahead += both[:, i] * force
            if rubs:
                ahead += both[:, 0] * (self.friction * z)
                # The move u is that under friction that stays, less what the friction at its end holds back in slip
                # lengths, held (1 - z w) (1 - exp(-|u| / slip)), w its direction: by the Lambert function.
                move = ahead[0] - s[0]
                way = np.copysign(1.0, move)
                rest = held * np.maximum(1.0 - z * way, 0.0)
                left = wrightomega(np.log(rest) + rest - np.abs(move) * per_slip)
                was, z = z, way * (1.0 - left / held)
                ahead += rubbing * (z - was)
            then = forces(ahead)
            for i, (force, later) in enumerate(zip(now, then, strict=True)):
                ahead += after[:, i] * (later - force)
            s, now = ahead, then
            states[n + 1] = s
        return states

    def _transition(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """State transition (4, 4, p) and the effect (4, 2, p) of the forces at the begin and the end of a step."""
        k, c, kt, ct = self.stiffness, self.damping, self.tire, self.tire_damping
        m, mu = self.mass, self.unsprung
        of = np.zeros((m.size, 8, 8))
        both = 1.0 / m + 1.0 / mu
        of[:, 0, 1] = of[:, 2, 3] = 1.0
        # The wheel feels -kt w - ct w'; the extension is that of the body less that of the wheel.
        of[:, 3, :4] = np.stack([k, c, -kt, -ct], axis=1) / mu[:, None]
        of[:, 1, :4] = np.stack([-k * both, -c * both, kt / mu, ct / mu], axis=1)
        of[:, 1, 4], of[:, 3, 4] = -both, 1.0 / mu
        of[:, 1, 5], of[:, 3, 5] = -1.0 / mu, 1.0 / mu
        # Forces linear over a step: their slopes are two more states.
        of[:, 4, 6] = of[:, 5, 7] = 1.0 / step
        whole = expm(of * step)
        after = whole[:, :4, 6:]
        before = whole[:, :4, 4:6] - after
        phi, before, after = (np.ascontiguousarray(a.transpose(1, 2, 0)) for a in (whole[:, :4, :4], before, after))
        return phi, before, after
