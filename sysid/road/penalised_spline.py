"""Penalised cubic spline of a bump: zero at its two ends, free to kink there, smoothness by marginal likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from sysid.arrays import Points, Stations


@dataclass(frozen=True)
class BinnedHeights:
    """Heights gathered in narrow bins: mean station and height (m,) [m] and the sum of weights (m,) of each.

    `scatter_m2` is the weighted sum of squares within the bins, `count` the sum of all weights (number of points).
    """

    station_m: np.ndarray
    height_m: np.ndarray
    weight: np.ndarray
    scatter_m2: float
    count: float


@dataclass(frozen=True)
class SplineFit:
    """Spline on [`start_m`, `end_m`], zero outside; `noise_m` is the residual scatter of one point of weight 1.

    `criterion` is minus twice the logarithm of the marginal likelihood up to a constant of the data: comparable between
    fits of the same data with other ends or another smoothness.
    """

    start_m: float
    end_m: float
    spline: BSpline
    noise_m: float
    smoothness: float
    criterion: float
    factor: np.ndarray

    def height_m(self, station_m: Stations) -> Stations:
        """Return the height [m] at stations [m], exactly zero outside the ends."""
        inside = (station_m > self.start_m) & (station_m < self.end_m)
        return np.where(inside, self.spline(np.clip(station_m, self.start_m, self.end_m)), 0.0)

    def slope(self, station_m: Stations) -> Stations:
        """Return dz/ds at stations [m], zero outside the ends."""
        inside = (station_m > self.start_m) & (station_m < self.end_m)
        return np.where(inside, self.spline(np.clip(station_m, self.start_m, self.end_m), nu=1), 0.0)

    def variance_m2(self, station_m: Stations) -> Stations:
        """Return the posterior variance [m^2] of the height at stations [m], zero outside the ends.

        Bayesian covariance of the coefficients: its band covers the truth at the stated rate on average along the
        curve (D. Nychka, Journal of the American Statistical Association 83 (1988) 1134-1143).
        """
        result = np.zeros_like(station_m)
        inside = np.flatnonzero((station_m > self.start_m) & (station_m < self.end_m))
        for block in np.array_split(inside, max(1, inside.size // 512)):
            if block.size == 0:
                continue
            design = BSpline.design_matrix(station_m[block], self.spline.t, 3).toarray()[:, 1:-1]
            solved = cho_solve_banded((self.factor, True), design.T)
            result[block] = self.noise_m**2 * np.einsum("ij,ji->i", design, solved)
        return result


def bin_heights(station_m: Points, height_m: Points, weight: Points, *, width_m: float = 0.001) -> BinnedHeights:
    """Gather points (n,) into bins of `width_m`; the spline sees their weighted means, which are sufficient for it."""
    label = np.floor((station_m - station_m.min()) / width_m).astype(np.int64)
    total = np.bincount(label, weights=weight)
    used = total > 0
    safe = np.where(used, total, 1.0)
    mean_station = np.bincount(label, weights=weight * station_m) / safe
    mean_height = np.bincount(label, weights=weight * height_m) / safe
    scatter = float(np.sum(weight * (height_m - mean_height[label]) ** 2))
    return BinnedHeights(mean_station[used], mean_height[used], total[used], scatter, float(np.sum(weight)))


def fit_spline(
    data: BinnedHeights, start_m: float, end_m: float, *, knot_spacing_m: float, smoothness: float | None = None
) -> SplineFit:
    r"""Fit the spline f that minimises sum_j w_j (z_j - f(s_j))^2 + lambda \int f''(s)^2 ds, f(start) = f(end) = 0.

    With lambda = `smoothness` None it maximises the marginal likelihood in which the penalty is a Gaussian prior and
    the noise variance is profiled out:
    -2 log L = n log(RSS + lambda c'Sc) + log|B'WB + lambda S| - log|lambda S|.
    Data outside the ends are explained by zero, so that fits with other ends can be compared.
    Source: P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89-121, doi:10.1214/ss/1038425655.
    """
    intervals = max(4, round((end_m - start_m) / knot_spacing_m))
    breaks = np.linspace(start_m, end_m, intervals + 1)
    knots = np.concatenate([[start_m] * 3, breaks, [end_m] * 3])
    inside = (data.station_m > start_m) & (data.station_m < end_m)
    station, height, weight = data.station_m[inside], data.height_m[inside], data.weight[inside]
    # Dropping the first and the last coefficient makes the spline zero at both ends and leaves its slope free.
    gram, right = _normal_equations(station, height, weight, knots)
    penalty = _penalty_band(knots, breaks)
    squares = float(np.sum(data.weight * data.height_m**2)) + data.scatter_m2
    log_penalty = _log_determinant(cholesky_banded(penalty, lower=True))
    coefficients = penalty.shape[1]
    # Dimensionless smoothness: lambda relative to the balance of the two matrices.
    unit = float(np.sum(gram[0])) / float(np.sum(penalty[0]))

    def solve(log_lambda: float) -> tuple[float, np.ndarray, np.ndarray, float]:
        strength = unit * np.exp(log_lambda)
        factor = cholesky_banded(gram + strength * penalty, lower=True)
        solution = cho_solve_banded((factor, True), right)
        # RSS + penalty at the minimum; the floor is the rounding of heights in the file (10 um).
        loss = max(squares - float(right @ solution), 1e-10 * data.count)
        criterion = data.count * np.log(loss) + _log_determinant(factor) - log_penalty - coefficients * np.log(strength)
        return criterion, solution, factor, loss

    def criterion_of(log_lambda: float) -> float:
        try:
            return solve(log_lambda)[0]
        except LinAlgError:
            return np.inf

    if smoothness is None:
        coarse = np.arange(-16.0, 30.1, 2.0)
        best = coarse[int(np.argmin([criterion_of(value) for value in coarse]))]
        optimum = minimize_scalar(criterion_of, bounds=(best - 2, best + 2), method="bounded", options={"xatol": 0.02})
        log_lambda = float(optimum.x)
    else:
        log_lambda = float(np.log(smoothness / unit))
    criterion, solution, factor, loss = solve(log_lambda)
    return SplineFit(
        start_m=start_m,
        end_m=end_m,
        spline=BSpline(knots, np.concatenate([[0.0], solution, [0.0]]), 3),
        noise_m=float(np.sqrt(loss / data.count)),
        smoothness=float(unit * np.exp(log_lambda)),
        criterion=float(criterion),
        factor=factor,
    )


def _normal_equations(
    station: np.ndarray, height: np.ndarray, weight: np.ndarray, knots: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lower bands (4, m) of B'WB and B'Wz, without the first and the last coefficient.

    At each station four splines differ from zero, one behind the other.
    """
    design = BSpline.design_matrix(station, knots, 3)
    spline, first = design.data.reshape(-1, 4), design.indices.reshape(-1, 4)[:, 0]
    count = design.shape[1]

    def summed(value: np.ndarray, place: int) -> np.ndarray:
        return np.bincount(first + place, weights=value, minlength=count)

    right = np.sum([summed(weight * height * spline[:, p], p) for p in range(4)], axis=0)
    band = np.zeros((4, count - 2))
    for k in range(4):
        diagonal = np.sum([summed(weight * spline[:, p] * spline[:, p + k], p) for p in range(4 - k)], axis=0)
        band[k, : count - 2 - k] = diagonal[1 : count - 1 - k]
    return band, right[1:-1]


def _penalty_band(knots: np.ndarray, breaks: np.ndarray) -> np.ndarray:
    """Return the lower bands of the matrix of integrals of products of second derivatives.

    The second derivative is linear between the breaks: two difference operators give its values there, the mass matrix
    of hat functions integrates their products.  The ends' own coefficients are zero and take no part, so that all
    matrices are square; they are kept by their diagonals.
    """
    size, step = breaks.size, np.diff(breaks)
    first = 3 / (knots[4 : size + 5] - knots[1 : size + 2])
    second = 2 / (knots[4 : size + 4] - knots[2 : size + 2])
    below, above = second * first[:-1], second * first[1:]
    below[0] = above[-1] = 0.0
    curvature = {1: above, 0: -second * first[:-1] - second * first[1:], -1: below}
    before, behind = np.append(0.0, step), np.append(step, 0.0)
    mass = {-1: before / 6, 0: behind / 3 + before / 3, 1: behind / 6}
    turned = {-offset: _moved(diagonal, -offset) for offset, diagonal in curvature.items()}
    penalty = _product(_product(turned, mass), curvature)
    return np.stack([_moved(penalty[-k], k) for k in range(4)])


def _product(left: dict[int, np.ndarray], right: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Diagonals of the product of two square matrices: the entry of row i stands at i, by its offset to the right."""
    result: dict[int, np.ndarray] = {}
    # Backwards: in the order in which sparse matrices of SciPy add, so that sums are rounded alike.
    for a, of_left in reversed(left.items()):
        for b, of_right in right.items():
            result[a + b] = result.get(a + b, 0.0) + of_left * _moved(of_right, a)
    return result


def _moved(diagonal: np.ndarray, rows: int) -> np.ndarray:
    """What stands so many rows below, 0 outside."""
    if rows >= 0:
        return np.append(diagonal[rows:], np.zeros(rows))
    return np.append(np.zeros(-rows), diagonal[:rows])


def _log_determinant(factor: np.ndarray) -> float:
    return 2.0 * float(np.sum(np.log(factor[0])))
