"""Which columns belong to one axle: threes and pairs that fulfil q'' = b - a, whatever their names say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from sysid.campaign.records import SensorKind
from sysid.campaign.units import STANDARD_GRAVITY_M_S2
from sysid.first_look.features import Threes

#: Share of q'' that a three may leave unexplained, and |ln| by which its factors may differ from each other.
_UNEXPLAINED, _FACTORS = 0.3, 0.5
#: Share that a pair may leave unexplained in the band of wheel hop, where the frame moves a little.
_PAIR_UNEXPLAINED = 0.4
#: Share that may be left where the unit in the name or in the file says something else.
_UNEXPLAINED_AGAINST = 0.08
#: How many times the share of wheel hop of the two others an axle acceleration has.
_MORE_HOP = 1.5
_LARGEST_COST = 6.0


@dataclass(frozen=True)
class Three:
    """Columns of one axle that fulfil q'' = beta b - alpha a, with the share left unexplained.

    Without a frame sensor `body` is None and `beta` NaN.
    """

    deflection: str
    axle: str
    body: str | None
    unexplained: float
    alpha: float
    beta: float


def matched_threes(fits: Sequence[Threes], hop: Mapping[str, float], dimension: Mapping[str, str]) -> tuple[Three, ...]:
    """Threes of columns that belong together, from the logs of one layout.

    Parameters
    ----------
    fits
        Fits of all threes, one per log.
    hop
        Share of the power in the band of wheel hop by column: an axle has more of it than the frame above.
    dimension
        ``length`` or ``acceleration`` of columns whose unit is said.  A match against it has to be a far better one.
    """
    names = sorted({n for fit in fits for n in fit.names})
    if len(names) < 2:
        return ()
    left, alpha, beta = _averaged(fits, names)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(np.log(np.abs(alpha / beta)))
        # Accelerations in g and in m/s^2 side by side are rare.
        ratio = np.minimum(ratio, np.abs(ratio - np.log(STANDARD_GRAVITY_M_S2)) + 0.15)
        cost = np.log(left + 0.003) + np.minimum((ratio / 0.15) ** 2, _LARGEST_COST)
    shares = np.array([hop.get(n, 0.0) for n in names])
    against = _against(names, dimension)
    cost[against & ~(left < _UNEXPLAINED_AGAINST)] = np.inf
    cost[~(left < _UNEXPLAINED) | ~(ratio < _FACTORS)] = np.inf
    hops = shares[:, None] > _MORE_HOP * shares[None, :]
    cost[:, ~hops] = np.inf
    cost[~hops.T] = np.inf
    picked = _picked(names, cost, left, alpha, beta)
    taken = {c for t in picked for c in (t.deflection, t.axle, t.body)}
    return (*picked, *_pairs(fits, names, shares, np.asarray(against.all(axis=2)), taken))


def _against(names: Sequence[str], dimension: Mapping[str, str]) -> np.ndarray:
    """Threes (q, a, b) of which a unit says that one is no deflection, or no acceleration."""
    no_length = np.array([dimension.get(n) == "acceleration" for n in names])
    no_acceleration = np.array([dimension.get(n) == "length" for n in names])
    return np.asarray(no_length[:, None, None] | no_acceleration[None, :, None] | no_acceleration[None, None, :])


def _pairs(
    fits: Sequence[Threes], names: Sequence[str], shares: np.ndarray, against: np.ndarray, taken: set[str | None]
) -> tuple[Three, ...]:
    """Deflections and axles that have no frame sensor, best first; `against` (q, a) units say that they are none."""
    place = {n: i for i, n in enumerate(names)}
    left, alpha = (np.full((len(fits), len(names), len(names)), np.nan) for _ in range(2))
    for k, fit in enumerate(fits):
        at = np.array([place[n] for n in fit.names])
        left[k][np.ix_(at, at)] = fit.pair_unexplained
        alpha[k][np.ix_(at, at)] = fit.pair_alpha
    seen = np.any(np.isfinite(left), axis=0)
    left[:, ~seen], alpha[:, ~seen] = 1.0, 1.0
    mean, middle = np.nanmean(left, axis=0), np.nanmedian(alpha, axis=0)
    mean[~(_MORE_HOP * shares[:, None] < shares[None, :])] = 1.0
    mean[against & ~(mean < _UNEXPLAINED_AGAINST)] = 1.0
    out = [i for i, n in enumerate(names) if n in taken]
    mean[out], mean[:, out] = 1.0, 1.0
    result = []
    while float(mean.min()) < _PAIR_UNEXPLAINED:
        q, a = (int(i) for i in np.unravel_index(int(np.argmin(mean)), mean.shape))
        result.append(Three(names[q], names[a], None, float(mean[q, a]), float(middle[q, a]), float("nan")))
        mean[[q, a]], mean[:, [q, a]] = 1.0, 1.0
    return tuple(result)


def _averaged(fits: Sequence[Threes], names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean share left and median factors over the logs, NaN where no log has the three."""
    place = {n: i for i, n in enumerate(names)}
    shape = (len(names),) * 3
    stacks = [np.full((len(fits), *shape), np.nan) for _ in range(3)]
    for k, fit in enumerate(fits):
        at = np.array([place[n] for n in fit.names])
        for stack, values in zip(stacks, (fit.unexplained, fit.alpha, fit.beta), strict=True):
            stack[k][np.ix_(at, at, at)] = values
    empty = np.all(np.isnan(stacks[0]), axis=0)
    for stack in stacks:
        stack[:, empty] = 1.0
    left, alpha, beta = np.nanmean(stacks[0], axis=0), np.nanmedian(stacks[1], axis=0), np.nanmedian(stacks[2], axis=0)
    left[empty] = np.nan
    return left, alpha, beta


def _picked(
    names: Sequence[str], cost: np.ndarray, left: np.ndarray, alpha: np.ndarray, beta: np.ndarray
) -> tuple[Three, ...]:
    """The best threes without a column twice; then the frame columns, which neighbours share, are dealt out anew."""
    free = cost.copy()
    chosen: list[tuple[int, int, int]] = []
    while np.isfinite(free).any():
        q, a, b = (int(i) for i in np.unravel_index(int(np.argmin(free)), free.shape))
        chosen.append((q, a, b))
        for i in (q, a, b):
            free[i], free[:, i], free[:, :, i] = np.inf, np.inf, np.inf
    if not chosen:
        return ()
    bodies = [b for _, _, b in chosen]
    table = np.array([[cost[q, a, b] for b in bodies] for q, a, _ in chosen])
    rows, columns = linear_sum_assignment(np.where(np.isfinite(table), table, 100.0))
    result = []
    for row, column in zip(rows, columns, strict=True):
        q, a, _ = chosen[row]
        b = bodies[column]
        result.append(
            Three(names[q], names[a], names[b], float(left[q, a, b]), float(alpha[q, a, b]), float(beta[q, a, b]))
        )
    return tuple(result)


def upright(three: Three, said: Mapping[str, SensorKind | None]) -> Three:
    """A three whose deflection is upside down, with axle and frame exchanged if their names `said` so.

    q'' = b - a turned round is the same equation as b and a exchanged: the share of wheel hop decides between them, but
    on axles that share a beam the frame may have more of it.
    """
    turned = three.alpha < 0.0 and three.beta < 0.0
    exchanged = three.body is not None and (said.get(three.axle), said.get(three.body)) == (
        "body_acceleration",
        "axle_acceleration",
    )
    if not (turned and exchanged and three.body is not None):
        return three
    return replace(three, axle=three.body, body=three.axle, alpha=-three.beta, beta=-three.alpha)
