"""How much more uncertain the optimum is than independent noise would make it: a sandwich over blocks of residuals.

If the model were right, the scores g_b = J_b' r_b of blocks b (one channel in all repeats of one case) would scatter
about zero with the covariance of the information H they carry.  Model error makes them scatter more: G = sum g_b g_b'
exceeds H.  The information is then H G^-1 H = C' H C (the curvature adjustment of M. Ribatet, D. Cooley and A. C.
Davison, Bayesian inference from composite likelihoods, Statistica Sinica 22 (2012), doi:10.5705/ss.2009.248).
Directions in which G does not exceed H by more than blocks of pure noise scatter keep H, so nothing becomes more
certain than independent noise allows.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.estimation.residuals.run_unknowns import with_own_priors
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, channel_columns
from sysid.threads import side_by_side
from sysid.vehicle_model.engines.protocol import Linearisation

#: Smallest eigenvalue of an information with a diagonal of ones.
_FLOOR = 1e-10


@dataclass(frozen=True)
class Adjustment:
    """Result of the sandwich for p global parameters.

    `matrix` C (p, p); `information` (p, p) adjusted data information C' H C; `inflation` (p,) eigenvalues of H^-1 G of
    the blocks, at least 1; `blocks` number of blocks; `effects` E (p, k): parameters that are off by E e, e ~ N(0, I),
    have the same information, (H^-1 + E E')^-1.
    """

    matrix: ParametersByParameters
    information: np.ndarray
    inflation: Parameters
    blocks: int
    effects: np.ndarray


class BlockScores(NamedTuple):
    """Scores (R, C, p) of single runs and channels, information (R, p, p) of runs, and `parts`, (p, p) of channels.

    Of the runs' own unknowns `own_score` (R, l) of the data, `own_normal` (R, l, l) with their prior precision, and
    `own_response` (R, l, p): how they follow the p unknowns, with opposite sign.
    """

    scores: np.ndarray
    information: np.ndarray
    parts: list[np.ndarray]
    own_score: np.ndarray
    own_normal: np.ndarray
    own_response: np.ndarray


def block_scores(
    linearisation: Linearisation,
    local_prior: np.ndarray,
    parts_of: np.ndarray | None = None,
    kinds: Sequence[ResidualColumns] = (),
    clocks: ResidualColumns | None = None,
) -> BlockScores:
    """Scores and information of a group of runs about p unknowns, with each run's own unknowns eliminated.

    Parameters
    ----------
    linearisation : of R runs, with arrays of the host.
    local_prior : (R, l, l) prior precision of the run's own unknowns.
    parts_of : (R, C) bool, channels whose information is wanted one by one, run after run; None for none.
    kinds : derivatives by further unknowns, which come after those of the parameters.
    clocks : derivatives by the clocks of every run, which are its own unknowns beside its motion; None for none.
    """
    runs = range(linearisation.residual.shape[1])
    each = side_by_side(
        lambda r: _run_scores(
            linearisation, r, local_prior[r], None if parts_of is None else parts_of[r], kinds, clocks
        ),
        runs,
    )
    scores, information, parts, *of_own = zip(*each, strict=True)
    flat = [part for of_run in parts for part in of_run]
    return BlockScores(np.array(scores), np.array(information), flat, *map(np.array, of_own))


def _run_scores(
    linearisation: Linearisation,
    r: int,
    local_prior: np.ndarray,
    parts_of: np.ndarray | None,
    kinds: Sequence[ResidualColumns],
    clocks: ResidualColumns | None,
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """What :class:`BlockScores` has of one run, information of the channels `parts_of` (C,)."""
    scores, by_channel = [], []
    normal: np.ndarray | float = 0.0
    # Channel by channel: einsum over all of them goes through the columns with strides that cost ten times as much.
    for c in range(linearisation.residual.shape[2]):
        columns, gain = channel_columns(linearisation, r, c, *kinds, clocks=clocks)
        scores.append(gain * linearisation.gain_residual[r, c] + linearisation.residual[:, r, c] @ columns)
        squares = columns.T @ columns + np.outer(gain, gain)
        normal = normal + squares
        by_channel.append(squares if parts_of is not None and parts_of[c] else None)
    whole = with_own_priors(np.asarray(normal), local_prior)
    wide = np.array(scores)
    equations, own = NormalEquations.of(whole, wide.sum(axis=0)), slice(-len(local_prior), None)
    left, response = equations.eliminate(own)
    change = np.concatenate([np.eye(len(left.matrix)), response])
    parts = [change.T @ squares @ change for squares in by_channel if squares is not None]
    return wide @ change, left.matrix, parts, equations.gradient[own], whole[own, own], -response


def noise_edge(blocks: int, count: int) -> float:
    """Scatter that blocks of pure noise do not exceed: 99 % quantile of the largest eigenvalue of their covariance.

    With n = blocks - 1 and p parameters, n l = mu + 2.02 sigma, mu = (sqrt(n - 1) + sqrt(p))^2, sigma = (sqrt(n - 1) +
    sqrt(p)) (1 / sqrt(n - 1) + 1 / sqrt(p))^(1/3) (I. M. Johnstone, On the distribution of the largest eigenvalue in
    principal components analysis, Annals of Statistics 29 (2001), doi:10.1214/aos/1009210544).
    """
    n = max(blocks - 1, 2)
    root, other = np.sqrt(n - 1.0), np.sqrt(float(count))
    spread = (root + other) * (1.0 / root + 1.0 / other) ** (1.0 / 3.0)
    return float(((root + other) ** 2 + 2.02 * spread) / n)


def _root(matrix: np.ndarray) -> np.ndarray:
    """Lower triangular root L L' of a scaled information; what data do not determine may be negative by rounding."""
    try:
        return np.linalg.cholesky(matrix + _FLOOR * np.eye(len(matrix)))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        # L' is the R of Q R = (V sqrt(values))', its signs turned to a positive diagonal.
        upper = np.linalg.qr((vectors * np.sqrt(np.maximum(values, _FLOOR))).T)[1]
        return np.asarray((np.sign(np.diag(upper))[:, None] * upper).T)


def adjust(
    scores: np.ndarray,
    keys: Sequence[Hashable],
    information: np.ndarray,
    *,
    never_sharper: bool = True,
) -> Adjustment:
    """Curvature adjustment from block scores.

    Parameters
    ----------
    scores : (n, p) scores; those with equal `keys` belong to one block and are summed.
    information : (p, p) data information H.
    never_sharper : keep H where the scores scatter no more than noise does (:func:`noise_edge`).
    """
    order = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    sums = np.zeros((len(order), scores.shape[1]))
    np.add.at(sums, [order[k] for k in keys], scores)
    # The scores of the data sum to the pull of the priors; that common part is no scatter.
    sums -= sums.mean(axis=0)
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0.0, scale, 1.0)
    factor = _root(information / np.outer(scale, scale))
    white = np.linalg.solve(factor, (sums / scale).T)
    values, vectors = np.linalg.eigh(white @ white.T * len(order) / max(len(order) - 1, 1))
    if never_sharper:
        inflation = np.where(values > noise_edge(len(order), scale.size), values, 1.0)
    else:
        inflation = np.maximum(values, 1e-12)
    root = vectors @ np.diag(inflation**-0.5) @ vectors.T
    matrix = np.linalg.solve(factor.T, root @ factor.T) * (scale[None, :] / scale[:, None])
    wider = inflation > 1.0
    effects = np.linalg.solve(factor.T, vectors[:, wider] * np.sqrt(inflation[wider] - 1.0)) / scale[:, None]
    return Adjustment(matrix, matrix.T @ information @ matrix, inflation, len(order), effects)
