"""What the posterior integrates out beside the parameters: masses, departures, model error and undecided laws.

Near the optimum (x_0, y_0) of p parameters x and q masses and departures y, the residuals of the data are

    r(x, y, e) = r(x_0 + D (x - x_0)) + J_y (y - y_0) + J_x E e + noise,    noise ~ N(0, f),

with y ~ N(0, L^-1) and e ~ N(0, I).  D: footprint maps that follow the tires
(:mod:`sysid.estimation.uncertainty.map_following`); E: by how much model error
(:mod:`sysid.estimation.uncertainty.sandwich`) and laws that the data do not decide move parameters; f: the factor of
model error on all variances.  With z = (e, (y - y_0) L^1/2) of unit variances, columns A = [J_x E, J_y L^-1/2] with the
runs' own unknowns eliminated, and c = (0, L^1/2 y_0), integrating z out of exp(-(|r + A z|^2 / f + |z + c|^2) / 2)
leaves the log-density

    -1/2 [ r'r / f + c'c - g' (I + A'A / f)^-1 g ],    g = A'r / f + c,

up to a constant: with eigenvectors u of A'A / f and eigenvalues s, a sum over (u'c)^2 - (u'g)^2 / (1 + s).

The columns are those of the optimum.  That is too rough where z takes back most of what a change of x does to the
residuals: what is left of r(x) after its linear part was taken back may well be as large as the misfit.  So a truck is
simulated that stays where the data want it.  With v = D (x - x_0), z is most likely z(v) = -(I + A'A / f)^-1 A'J_x v /
f, and the residuals change by J_x v + A z(v) = J B v.  Parameters imitate that best by W v, W = (H_xx + P)^-1 H_x B,
with the information H of the data and the prior precision P, so

    r(x_0 + W v) + J (B - W) v

stands for the residuals, the rest J (B - W) v being linear, and c + z(v) for c.  Where r is linear, nothing changes.
If a truck grows by one share, all its masses and all forces, it moves as before: then W v = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import DrawsByParameters, ParametersByParameters

#: Eigenvalues s below this one are left out: of the log-density they change less than half as much.
_LEAST = 1e-3
#: Squares of what a standard deviation of the parameters changes below which a part of the rest is left out.
_LEAST_REST = 1e-6


@dataclass(frozen=True)
class ErrorGivenParameters:
    """Model error e (k,) given D (x - x_0) (p,): normal, with the mean `response` (k, p) times this.

    Its covariance is `factor` `factor`' (k, k).
    """

    response: np.ndarray
    factor: np.ndarray

    @classmethod
    def of(cls, effects: np.ndarray, information: ParametersByParameters) -> ErrorGivenParameters:
        """From E (p, k) and the information N (p, p) of the data, masses and departures integrated out."""
        resisted = effects.T @ information
        root = np.linalg.inv(np.linalg.cholesky(np.eye(effects.shape[1]) + resisted @ effects)).T
        return cls(-root @ root.T @ resisted, root)


@dataclass(frozen=True)
class IntegratedUnknowns:
    """What is integrated out of the density of p parameters, along K combinations of p parameters and q other unknowns.

    - `factor`: f on the variances of the data;
    - `following` (p, p): D; all that follows is per unit of D (x - x_0):
    - `simulated_share` (p, p): W, and `rest` (m, p): what the residuals change beside;
    - `directions` (p + q, K + m): columns [J_x J_y] times this are A u, then those of the rest; `sizes` (K,) are the s,
      `pull` (K,) is u'c at x_0, and `pull_by_change` (K, p) its change;
    - `products` (K, m) of A u with the columns of the rest over f, and `squares` (m,) of these over f.
    """

    factor: float
    following: ParametersByParameters
    simulated_share: ParametersByParameters
    rest: np.ndarray
    directions: np.ndarray
    sizes: np.ndarray
    pull: np.ndarray
    pull_by_change: np.ndarray
    products: np.ndarray
    squares: np.ndarray

    def followed(self, change: DrawsByParameters) -> DrawsByParameters:
        """D (x - x_0) (n, p) for changes x - x_0 (n, p)."""
        return _times(change, self.following)

    def simulated(self, followed: DrawsByParameters) -> DrawsByParameters:
        """Which changes (n, p) of the parameters are simulated for D (x - x_0) (n, p)."""
        return _times(followed, self.simulated_share)

    def log_density(self, squares: np.ndarray, products: np.ndarray, followed: DrawsByParameters) -> np.ndarray:
        """Log-density (n,) of the data from r'r (n,), products of r with the columns (K + m, n), and D (x - x_0)."""
        along, with_rest = np.split(products / self.factor, [self.sizes.size])
        rest = _times(followed, self.rest)
        pull = self.pull + _times(followed, self.pull_by_change)
        gradient = along.T + _times(rest, self.products) + pull
        misfit = squares / self.factor + (rest * (2.0 * with_rest.T + self.squares * rest)).sum(axis=1)
        return np.asarray(-0.5 * (misfit + (pull**2 - gradient**2 / (1.0 + self.sizes)).sum(axis=1)))


def _times(vectors: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Matrix (m, p) times each of n vectors (n, p).

    Not by a matrix product, whose rounding depends on how many vectors there are.
    """
    return np.asarray((vectors[:, None, :] * matrix).sum(axis=-1))


def nothing_integrated(count: int) -> IntegratedUnknowns:
    """The density of p parameters alone."""
    none, same, empty = np.zeros(0), np.eye(count), np.zeros((0, count))
    return IntegratedUnknowns(1.0, same, same, empty, empty.T, none, none, empty, np.zeros((0, 0)), none)


def integrated_unknowns(
    matrix: np.ndarray,
    prior: ParametersByParameters,
    effects: np.ndarray,
    sd: np.ndarray,
    amounts: np.ndarray,
    factor: float,
    following: ParametersByParameters,
) -> IntegratedUnknowns:
    """What is to be integrated out about an optimum.

    Parameters
    ----------
    matrix : (p + q, p + q) H, information of the data, over `factor`, the runs' own unknowns eliminated.
    prior : (p, p) precision of the parameters.
    effects : (p, k) E; sd : (q,) prior standard deviations of y, 0 for what is held; amounts : (q,) y_0.
    factor : f; following : (p, p) D.
    """
    count, further = effects.shape
    roots = np.zeros((len(matrix), further + sd.size))
    roots[:count, :further] = effects
    roots[count:, further:] = np.diag(sd)
    over_sd = np.divide(amounts, sd, where=sd > 0.0, out=np.zeros(sd.size))
    values, vectors = np.linalg.eigh(roots.T @ matrix @ roots)
    kept = values > _LEAST
    values, vectors = values[kept], vectors[:, kept]
    along = roots @ vectors
    taken_back = -(along.T @ matrix[:, :count]) / (1.0 + values[:, None])
    change = along @ taken_back
    change[:count] += np.eye(count)
    resisted = matrix[:count] @ change
    # Parameters of which the data say nothing stay where they are.
    simulated = np.linalg.solve(matrix[:count, :count] + prior, resisted)
    change[:count] -= simulated
    # What the rest amounts to, in standard deviations of the parameters.
    root = np.linalg.cholesky(0.5 * (resisted + resisted.T) + prior)
    columns = np.linalg.solve(root, change.T).T
    squares, axes = np.linalg.eigh(columns.T @ matrix @ columns)
    seen = squares > _LEAST_REST
    columns = columns @ axes[:, seen]
    return IntegratedUnknowns(
        factor=factor,
        following=following,
        simulated_share=simulated,
        rest=(root @ axes[:, seen]).T,
        directions=np.column_stack([along, columns]),
        sizes=values,
        pull=over_sd @ vectors[further:],
        pull_by_change=taken_back,
        products=along.T @ matrix @ columns,
        squares=squares[seen],
    )
