"""Quadratic forms of many members side by side, and Gaussian integrals over a part of them.

exp(-z'A z / 2) with z = (x, e, 1) is the likelihood of a campaign, or of a truck, in its log parameters x and in the
errors e that campaigns share.  Members stand last, (n, r, c, m) for n sets of hyperparameters: what is a loop over the
few rows of small matrices here works on all members at once.
"""

from __future__ import annotations

import numpy as np


def forms_of(precision: np.ndarray, shift: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """A (q, q, m) of likelihoods exp(-y'L y / 2 + h'y), y = x + B e; q = d + S + 1.

    Parameters
    ----------
    precision, shift, moved : L (m, d, d), h (m, d), B (m, d, S).
    """
    d, errors = moved.shape[1:]
    to_y = np.concatenate([np.broadcast_to(np.eye(d), precision.shape), moved], axis=2)
    forms = np.zeros((len(precision), d + errors + 1, d + errors + 1))
    forms[:, :-1, :-1] = to_y.transpose(0, 2, 1) @ precision @ to_y
    forms[:, :-1, -1] = forms[:, -1, :-1] = -np.einsum("mds,md->ms", to_y, shift)
    return np.ascontiguousarray(forms.transpose(1, 2, 0))


def integrated(forms: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What integrating x ~ N(y, F F') out of forms takes: C', V = C^-1 F'A and log det (n, m), for I + F'A F = C C'.

    In (y, e, 1) the forms are A - V'V afterwards, and the integral is exp(-log det / 2) times that.  It is finite where
    F is zero and where a form says nothing of x.

    Parameters
    ----------
    forms : A (q, q, m), or (n, q, q, m).
    root : F (n, d, d).

    Returns
    -------
    C' (n, d, d, m), of which only the upper triangle counts, V (n, q, d, m) by columns of A, log det (n, m).
    """
    n, d, _ = root.shape
    members = forms.shape[-1]
    turned = root.transpose(0, 2, 1)
    rows = turned[:, None] @ forms[..., :d, :]
    pivots = (turned @ rows[:, :d].reshape(n, d, d * members)).reshape(n, d, d, members)
    pivots[:, np.arange(d), np.arange(d)] += 1.0
    return pivots, rows, eliminated(pivots, rows)


def eliminated(pivots: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Make C' of W = C C' (n, d, d, m) and C^-1 u of rows u (n, r, d, m), both in place; log det W (n, m)."""
    d = pivots.shape[1]
    product = np.ones((len(pivots), pivots.shape[3]))
    for i in range(d):
        product *= pivots[:, i, i]
        scale = 1.0 / np.sqrt(pivots[:, i, i])
        pivots[:, i, i:] *= scale[:, None]
        rows[:, :, i] *= scale[:, None]
        factor = pivots[:, i, i + 1 :].copy()
        pivots[:, i + 1 :, i + 1 :] -= factor[:, :, None] * factor[:, None]
        rows[:, :, i + 1 :] -= factor[:, None] * rows[:, :, i, None]
    return np.asarray(np.log(product))


def solved_back(upper: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x (n, d, m) of C'x = b for C' (n, d, d, m), or (1, d, d, m), and b (n, d, m), in place of b."""
    for i in reversed(range(upper.shape[1])):
        for j in range(i + 1, upper.shape[1]):
            right[:, i] -= upper[:, i, j] * right[:, j]
        right[:, i] /= upper[:, i, i]
    return right


def squared(rows: np.ndarray) -> np.ndarray:
    """V'V (n, q, q, m) of V (n, q, d, m), member by member."""
    product = rows[:, :, None, 0] * rows[:, None, :, 0]
    for i in range(1, rows.shape[2]):
        product += rows[:, :, None, i] * rows[:, None, :, i]
    return np.asarray(product)


def sum_of_squares(rows: np.ndarray) -> np.ndarray:
    """The same (n, q, q), summed over all members."""
    flat = rows.reshape(*rows.shape[:2], -1)
    return np.asarray(flat @ flat.transpose(0, 2, 1))


def inverted(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (n, d, d, m) and log determinants (n, m) of symmetric positive definite matrices, by elimination."""
    d = matrices.shape[1]
    inverse, product = matrices.copy(), np.ones((len(matrices), matrices.shape[3]))
    for i in range(d):
        # The sweep operator (J. H. Goodnight, The American Statistician 33 (1979), 149).
        pivot = inverse[:, i, i].copy()
        product *= pivot
        row = inverse[:, i] / pivot[:, None]
        column = inverse[:, :, i].copy()
        inverse -= column[:, :, None] * row[:, None]
        inverse[:, i], inverse[:, :, i] = row, row
        inverse[:, i, i] = -1.0 / pivot
    return np.negative(inverse, out=inverse), np.asarray(np.log(product))
