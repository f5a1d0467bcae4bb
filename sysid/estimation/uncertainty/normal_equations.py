"""Half the sum of squares about a point as a quadratic of its unknowns, and what that says about some of them.

With the information H of the data, the precision L of the priors and the gradient g of both about unknowns z,

    cost(z) = cost(0) + g'z + 1/2 z'A z,    A = H + L,
    step -A^-1 g,    gain cost(0) - cost(step) = 1/2 g'A^-1 g,    covariance A^-1.

At their best for given x, unknowns y follow it by -A_yy^-1 A_yx. This eliminates them (Schur complement), which is also
how a normal distribution is integrated over y:

    A_xx - A_xy A_yy^-1 A_yx,    g_x - A_xy A_yy^-1 g_y.

What one more unknown would gain beside others that follow it is the score test u^2 / v of its gradient u and
information v after their elimination (C. R. Rao, Large sample tests of statistical hypotheses concerning several
parameters, Mathematical Proceedings of the Cambridge Philosophical Society 44 (1948), doi:10.1017/S0305004100023987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtrtri

from sysid.arrays import ParametersByParameters, Unknowns, UnknownsByUnknowns

_NONE = np.zeros(0)


class Eliminated(NamedTuple):
    """Equations of k unknowns that are left, and how the g that were eliminated follow these: `response` (g, k)."""

    left: NormalEquations
    response: np.ndarray


@dataclass(frozen=True)
class NormalEquations:
    """Equations of n unknowns, each counted in a `unit` of its own (n,): `matrix` A (n, n) and `gradient` g (n,)."""

    matrix: UnknownsByUnknowns
    gradient: Unknowns
    unit: Unknowns

    @classmethod
    def of(
        cls,
        information: UnknownsByUnknowns,
        score: Unknowns | None = None,
        *,
        sd: Unknowns = _NONE,
        prior: ParametersByParameters | None = None,
        pull: Unknowns | None = None,
        amounts: Unknowns | None = None,
    ) -> NormalEquations:
        """Equations of p parameters, then of m further unknowns.

        The further unknowns are counted in their prior standard deviations. So one of zero is held where it is.

        Parameters
        ----------
        information : (p + m, p + m) H of the data; score : (p + m,) gradient of half their sum of squares, None for 0.
        sd : (m,) prior standard deviations of the further unknowns about 0, infinite for those without a prior;
            amounts : (m,) where they are, None for 0.
        prior : (p, p) precision of the parameters; pull : (p,) gradient of half the sum of squares of their priors;
            None for 0.
        """
        count, bounded = len(information) - sd.size, np.isfinite(sd)
        unit = np.concatenate([np.ones(count), np.where(bounded, sd, 1.0)])
        matrix = unit[:, None] * information * unit
        if prior is not None:
            matrix[:count, :count] += prior
        further = np.arange(count, unit.size)
        matrix[further, further] += bounded
        gradient = np.zeros(unit.size) if score is None else unit * score
        if pull is not None:
            gradient[:count] += pull
        if amounts is not None:
            gradient[count:] += np.divide(amounts, sd, where=bounded & (sd > 0.0), out=np.zeros(further.size))
        return cls(matrix, gradient, unit)

    @cached_property
    def _factor(self) -> np.ndarray | None:
        """Lower triangular root of the matrix; None where rounding has made one without information indefinite."""
        factor, failed = dpotrf(self.matrix, lower=True)
        return None if failed else factor

    def _solved(self, right: np.ndarray) -> np.ndarray:
        if not right.size:
            return right
        if self._factor is None:
            return np.linalg.solve(self.matrix, right)
        return np.asarray(dpotrs(self._factor, right, lower=True)[0])

    @cached_property
    def _inverse(self) -> np.ndarray:
        if not self.unit.size:
            return self.matrix
        if self._factor is None:
            inverse = np.linalg.inv(self.matrix)
            return np.asarray(0.5 * (inverse + inverse.T))
        lower = np.tril(dpotri(self._factor, lower=True)[0])
        return np.asarray(lower + np.tril(lower, -1).T)

    def step(self, further: UnknownsByUnknowns | None = None) -> Unknowns:
        """The step (n,) to the least cost; `further` (n, n) is added to H where gradients hold what follows a step."""
        if further is None:
            return np.asarray(-self.unit * self._solved(self.gradient))
        root = np.sqrt(np.diag(self.matrix))
        whole = (self.matrix + self.unit[:, None] * further * self.unit) / np.outer(root, root)
        return np.asarray(-self.unit / root * np.linalg.solve(whole, self.gradient / root))

    @property
    def gain(self) -> float:
        """By how much the step lowers half the sum of squares."""
        return 0.5 * float(self.gradient @ self._solved(self.gradient))

    @property
    def covariance(self) -> UnknownsByUnknowns:
        """Covariance (n, n) of the unknowns."""
        return np.asarray(self.unit[:, None] * self._inverse * self.unit)

    @property
    def variances(self) -> Unknowns:
        """Variances (n,) of the unknowns."""
        if self._factor is None or not self.unit.size:
            return np.asarray(np.diag(self._inverse) * self.unit**2)
        # A = L L': the diagonal of its inverse needs that of L alone.
        return np.asarray((dtrtri(self._factor, lower=True)[0] ** 2).sum(axis=0) * self.unit**2)

    @property
    def log_determinant(self) -> float:
        """ln det A, in the units of the unknowns."""
        if self._factor is None or not self.unit.size:
            return float(np.linalg.slogdet(self.matrix)[1])
        return 2.0 * float(np.log(np.diag(self._factor)).sum())

    @property
    def covariance_factor(self) -> UnknownsByUnknowns:
        """Lower triangular F (n, n) with the covariance F F'."""
        return np.asarray(self.unit[:, None] * np.linalg.cholesky(self._inverse))

    def only(self, kept: slice | Sequence[int] | np.ndarray) -> NormalEquations:
        """Equations of some unknowns while all others are held."""
        at = np.arange(self.unit.size)[kept]
        return NormalEquations(self.matrix[np.ix_(at, at)], self.gradient[at], self.unit[at])

    def eliminate(self, gone: slice | Sequence[int] | np.ndarray) -> Eliminated:
        """Equations of the unknowns that are left when some follow them."""
        every = np.arange(self.unit.size)
        at, kept = every[gone], np.delete(every, gone)
        solved = self.only(at)._solved(self.matrix[np.ix_(at, kept)])
        matrix = self.matrix[np.ix_(kept, kept)] - self.matrix[np.ix_(kept, at)] @ solved
        gradient = self.gradient[kept] - solved.T @ self.gradient[at]
        left = NormalEquations(0.5 * (matrix + matrix.T), gradient, self.unit[kept])
        return Eliminated(left, -self.unit[at][:, None] * solved)

    def along(self, directions: np.ndarray) -> NormalEquations:
        """Equations of k amplitudes along `directions` (n, k) of the unknowns in their units."""
        matrix = directions.T @ self.matrix @ directions
        return NormalEquations(matrix, directions.T @ self.gradient, np.ones(directions.shape[1]))

    def score_tests(self) -> tuple[Unknowns, Unknowns]:
        """What each unknown alone gains of the sum of squares, u^2 / v, and its step -u / v: (n,) each.

        An unknown that moves nothing gains nothing.
        """
        information, zero = np.diag(self.matrix), np.zeros(self.unit.size)
        step = np.divide(-self.gradient, information, where=information > 0.0, out=zero)
        return -step * self.gradient, step * self.unit
