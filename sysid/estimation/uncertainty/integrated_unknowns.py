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

The columns are those of the optimum.  That is too rough for changes of x that the data do not resist: the residuals
would hardly change, but what is left of r(x) after its linear part was taken back can be as large as the misfit.  So
the truck is simulated where these changes leave it, and z counts from there.

- Model error takes over what the data resist least: with N the information about x, masses and departures integrated
  out, e = -(I + E'N E)^-1 E'N D (x - x_0) is its most likely value.  x_0 + S D (x - x_0) is simulated, S = I - E (I +
  E'N E)^-1 E'N, and c begins with e.
- If a truck grows by one share, all its masses t and forces h (to first order, a step h of the parameters with J_x h =
  -J_y t), it moves as before.  With a = w'S D (x - x_0) the share that brings the parameters nearest to the optimum, a
  truck with a h less is simulated, and y_0 + a t stands in place of y_0.  The residuals get a (J_x h + J_y t), which is
  next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import DrawsByParameters, Parameters, ParametersByParameters

#: Eigenvalues s below this one are left out: of the log-density they change less than half as much.
_LEAST = 1e-3


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
    - `simulated_share` (p, p): of which truck is simulated, (I - h w') S, and `share` (p,): a, S'w;
    - `directions` (p + q, K + 1): columns [J_x J_y] times this are A u, then J_x h + J_y t; `sizes` (K,) are the s, and
      `pull` (K,) is u'c at x_0, `pull_by_change` (K, p) its change;
    - `by_share` (K,): change of the products with A u over f per unit of a, and `square_of_share` half the second
      derivative of r'r / f.
    """

    factor: float
    following: ParametersByParameters
    simulated_share: ParametersByParameters
    share: Parameters
    directions: np.ndarray
    sizes: np.ndarray
    pull: np.ndarray
    pull_by_change: np.ndarray
    by_share: np.ndarray
    square_of_share: float

    def followed(self, change: DrawsByParameters) -> DrawsByParameters:
        """D (x - x_0) (n, p) for changes x - x_0 (n, p)."""
        return _times(change, self.following)

    def simulated(self, followed: DrawsByParameters) -> DrawsByParameters:
        """Which changes (n, p) of the parameters are simulated for D (x - x_0) (n, p)."""
        return _times(followed, self.simulated_share)

    def log_density(self, squares: np.ndarray, products: np.ndarray, followed: DrawsByParameters) -> np.ndarray:
        """Log-density (n,) of the data from r'r (n,), products of r with the columns (K + 1, n), and D (x - x_0)."""
        *along, rest = products / self.factor
        share = _times(followed, self.share[None])[:, 0]
        pull = self.pull[:, None] + _times(followed, self.pull_by_change).T
        gradient = np.reshape(along, pull.shape) + self.by_share[:, None] * share + pull
        misfit = squares / self.factor + 2.0 * share * rest + self.square_of_share * share**2
        return np.asarray(-0.5 * (misfit + (pull**2 - gradient**2 / (1.0 + self.sizes[:, None])).sum(axis=0)))


def _times(vectors: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Matrix (m, p) times each of n vectors (n, p).

    Not by a matrix product, whose rounding depends on how many vectors there are.
    """
    return np.asarray((vectors[:, None, :] * matrix).sum(axis=-1))


def nothing_integrated(count: int) -> IntegratedUnknowns:
    """The density of p parameters alone."""
    none, zero, same = np.zeros(0), np.zeros(count), np.eye(count)
    return IntegratedUnknowns(1.0, same, same, zero, np.zeros((count, 1)), none, none, np.zeros((0, count)), none, 0.0)


def integrated_unknowns(
    matrix: np.ndarray,
    prior: ParametersByParameters,
    effects: np.ndarray,
    error: ErrorGivenParameters,
    sd: np.ndarray,
    amounts: np.ndarray,
    grows: np.ndarray,
    factor: float,
    following: ParametersByParameters,
) -> IntegratedUnknowns:
    """What is to be integrated out about an optimum.

    Parameters
    ----------
    matrix : (p + q, p + q) information of the data, over `factor`, the runs' own unknowns eliminated.
    prior : (p, p) precision of the parameters.
    effects : (p, k) E; error : e given the parameters.
    sd : (q,) prior standard deviations of y, 0 for what is held; amounts : (q,) y_0.
    grows : (q,) t; factor : f; following : (p, p) D.
    """
    count, further = effects.shape
    roots = np.zeros((len(matrix), further + sd.size))
    roots[:count, :further] = effects
    roots[count:, further:] = np.diag(sd)
    over_sd = np.divide([amounts, grows], sd, where=sd > 0.0, out=np.zeros((2, sd.size)))
    pulls = np.concatenate([np.zeros((2, further)), over_sd], axis=1)
    values, vectors = np.linalg.eigh(roots.T @ matrix @ roots)
    kept = values > _LEAST
    values, vectors = values[kept], vectors[:, kept]
    pull, pull_by_share = pulls @ vectors
    kept_by_error = np.eye(count) + effects @ error.response
    about = matrix[:count, :count]
    # Parameters of which the data say nothing stay where they are.
    growth = -np.linalg.solve(about + prior, matrix[:count, count:] @ grows)
    towards = about @ growth
    share = kept_by_error.T @ towards / (growth @ towards) if grows.any() else np.zeros(count)
    rest, along = np.concatenate([growth, grows]), roots @ vectors
    return IntegratedUnknowns(
        factor=factor,
        following=following,
        simulated_share=kept_by_error - np.outer(growth, share),
        share=share,
        directions=np.column_stack([along, rest]),
        sizes=values,
        pull=pull,
        pull_by_change=np.outer(pull_by_share, share) + vectors[:further].T @ error.response,
        by_share=along.T @ matrix @ rest,
        square_of_share=float(rest @ matrix @ rest),
    )
