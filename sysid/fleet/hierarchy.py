"""Type -> truck -> campaign for Gaussian campaigns: what is linear is integrated out, the rest is sampled.

Of one type, with log parameters x (d,), trucks t, campaigns c of a truck and shared errors e (S,):

    theta_t ~ N(mu, T),   T = diag(tau) R diag(tau)         trucks about their type
    x_tc ~ N(theta_t, diag(phi^2))                          a truck on another day
    campaign:  exp(-y' L y / 2 + h' y),  y = x_tc + A_c e   its likelihood, prior divided out
    mu ~ N(m0, s0^2),  e_s ~ N(0, sd_s^2),  tau, phi ~ half-Cauchy

R has one correlation per quantity between its axles.  Given tau, phi and the correlations everything else is Gaussian:
x and theta are integrated out truck by truck, mu and e together at last.  All forms below stay finite where tau or phi
are zero or a campaign says nothing of a parameter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from sysid.fleet.quadratic_forms import forms_of, integrated, inverted, solved_back, squared, sum_of_squares
from sysid.threads import side_by_side

#: Campaigns, and pairs of a campaign and a set of hyperparameters, that are computed at once: matrices of some MB.
_CAMPAIGNS_AT_ONCE = 1024
_PAIRS_AT_ONCE = 2048
#: Numbers of all matrices of one piece of the rows of draws: pieces decide the order of random numbers.
_NUMBERS_AT_ONCE = 250_000


@dataclass(frozen=True)
class HyperPriors:
    """Priors of a population: `mean_sd` of the type's mean, scales of the half-Cauchy priors of spread and scatter.

    In logarithms: 0.2 is a spread of 20 %.
    """

    mean_sd: float = 3.0
    spread_scale: float = 0.2
    scatter_scale: float = 0.05
    correlated: bool = True


@dataclass(frozen=True)
class TypeData:
    """All campaigns of one type.

    - `names`, `quantities` of the d parameters;
    - `trucks`;
    - `truck_of` (C,): index of every campaign's truck, ascending;
    - `campaigns`;
    - `precision` (C, d, d) and `shift` (C, d) of the likelihoods;
    - `moved` (C, d, S) and `shared_sd` (S,) of shared errors;
    - `mean` (d,): centre of the prior of the type's mean.
    """

    names: tuple[str, ...]
    quantities: tuple[str, ...]
    trucks: tuple[str, ...]
    campaigns: tuple[str, ...]
    truck_of: np.ndarray
    precision: np.ndarray
    shift: np.ndarray
    mean: np.ndarray
    moved: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    shared_sd: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if np.any(np.diff(self.truck_of) < 0):
            raise ValueError("campaigns are expected truck after truck")
        if self.moved.size == 0:
            object.__setattr__(self, "moved", np.zeros((len(self.campaigns), len(self.names), self.shared_sd.size)))

    @property
    def repeated(self) -> bool:
        """Whether a truck has more than one campaign, so that the scatter of repeats can be told from the spread."""
        return len(self.campaigns) > len(set(self.truck_of.tolist()))


@dataclass(frozen=True)
class Conditional:
    """Draws given hyperparameters: `mean` (n, d) of the type, `shared` (n, S), `trucks` (n, trucks, d)."""

    mean: np.ndarray
    shared: np.ndarray
    trucks: np.ndarray


class Hierarchy:
    """The model of one type; `names` and `start` of its hyperparameters, all positive and sampled as logarithms."""

    def __init__(self, data: TypeData, priors: HyperPriors):
        self.data, self.priors = data, priors
        self._groups = [np.flatnonzero([q == name for q in data.quantities]) for name in dict.fromkeys(data.quantities)]
        self._named = list(dict.fromkeys(data.quantities))
        self._correlated = [g for g, at in enumerate(self._groups) if at.size > 1] if priors.correlated else []
        # About the prior's mean: about zero, sums over many campaigns are so large that a search sees their rounding.
        self._forms = forms_of(data.precision, data.shift - data.precision @ data.mean, data.moved)
        self._blocks = list(_blocks(data.truck_of))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the hyperparameters: spreads, odds of correlations, scatters of repeats."""
        spreads = [f"spread[{n}]" for n in self.data.names]
        odds = [f"correlation_odds[{self._named[g]}]" for g in self._correlated]
        scatters = [f"scatter[{q}]" for q in self._named] if self.data.repeated else []
        return (*spreads, *odds, *scatters)

    @cached_property
    def start(self) -> np.ndarray:
        """Where a search begins: spreads and scatters at half of their scales, no correlation."""
        start = np.zeros(len(self.names))
        start[: len(self.data.names)] = np.log(0.5 * self.priors.spread_scale)
        for i, name in enumerate(self.names):
            if name.startswith("scatter"):
                start[i] = np.log(0.5 * self.priors.scatter_scale)
            elif name.startswith("correlation"):
                lowest = self._lowest(self._correlated[i - len(self.data.names)])
                start[i] = np.log(-lowest)
        return start

    def spread(self, log_hyper: np.ndarray) -> np.ndarray:
        """Covariance T (n, d, d) of trucks about their type."""
        tau = np.exp(log_hyper[:, : len(self.data.names)])
        return np.asarray(tau[:, :, None] * self._correlations(log_hyper) * tau[:, None, :])

    def _root(self, log_hyper: np.ndarray) -> np.ndarray:
        """F (n, d, d) of T = F F'."""
        tau = np.exp(log_hyper[:, : len(self.data.names)])
        return np.asarray(tau[:, :, None] * np.linalg.cholesky(self._correlations(log_hyper)))

    def _correlations(self, log_hyper: np.ndarray) -> np.ndarray:
        """R (n, d, d)."""
        d = len(self.data.names)
        correlation = np.broadcast_to(np.eye(d), (len(log_hyper), d, d)).copy()
        for position, g in enumerate(self._correlated):
            at, rho = self._groups[g], self._correlation(log_hyper[:, d + position], g)
            block = np.broadcast_to(rho[:, None, None], (len(rho), at.size, at.size)).copy()
            block[:, np.arange(at.size), np.arange(at.size)] = 1.0
            correlation[:, at[:, None], at] = block
        return correlation

    def scatter(self, log_hyper: np.ndarray) -> np.ndarray:
        """Variances phi^2 (n, d) of a truck's campaigns about the truck; zero where no truck has two."""
        out = np.zeros((len(log_hyper), len(self.data.names)))
        if self.data.repeated:
            for g, at in enumerate(self._groups):
                out[:, at] = np.exp(2.0 * log_hyper[:, len(self.names) - len(self._groups) + g])[:, None]
        return out

    def _lowest(self, group: int) -> float:
        return -1.0 / (self._groups[group].size - 1)

    def _correlation(self, log_odds: np.ndarray, group: int) -> np.ndarray:
        """Correlation between its bounds -1/(m - 1) and 1; a little inside, where the matrix has an inverse."""
        lowest = self._lowest(group)
        return np.asarray(lowest + (1.0 - lowest) * (1e-6 + (1.0 - 2e-6) / (1.0 + np.exp(-log_odds))))

    def __call__(self, log_hyper: np.ndarray) -> np.ndarray:
        """Log-density (n,) of log hyperparameters (n, h), up to a constant."""
        log_hyper = np.atleast_2d(log_hyper)
        with np.errstate(all="ignore"):
            sums = self.totals(log_hyper)
            value = sums.constant + 0.5 * np.einsum("nb,nb->n", sums.linear, sums.mean)
            value += self._log_prior(log_hyper) - 0.5 * np.linalg.slogdet(sums.precision)[1]
        return np.where(np.isfinite(value), value, -np.inf)

    def totals(self, log_hyper: np.ndarray) -> Totals:
        """Sums over all trucks for log hyperparameters (n, h)."""
        most = max(1, _PAIRS_AT_ONCE // min(len(self.data.campaigns), _CAMPAIGNS_AT_ONCE))
        pieces = np.array_split(log_hyper, -(-len(log_hyper) // most))
        parts = side_by_side(self._summed, pieces)
        forms, constant = (np.concatenate(some) for some in zip(*parts, strict=True))
        spread, scatter = self.spread(log_hyper), self.scatter(log_hyper)
        prior = np.r_[np.full(len(self.data.names), self.priors.mean_sd**-2.0), self.data.shared_sd**-2.0]
        precision, linear = forms[:, :-1, :-1], -forms[:, :-1, -1]
        precision = 0.5 * (precision + precision.transpose(0, 2, 1)) + np.diag(prior)
        mean = np.linalg.solve(precision, linear[..., None])[..., 0]
        return Totals(precision, linear, mean, constant, spread, scatter)

    def _summed(self, log_hyper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forms (n, q, q) of all trucks together, and logarithm (n,) of what stands before their exponentials."""
        root, scatter = self._root(log_hyper), self.scatter(log_hyper)
        forms, constant = np.zeros((len(log_hyper), *self._forms.shape[:2])), np.zeros(len(log_hyper))
        for block in self._blocks:
            trucks, log_det = self._trucks(block, scatter)
            _, rows, of_trucks = integrated(trucks, root)
            forms += trucks.sum(axis=-1) - sum_of_squares(rows)
            constant -= 0.5 * (log_det + of_trucks.sum(axis=1))
        return forms, constant - 0.5 * forms[:, -1, -1]

    def _trucks(self, block: _Block, scatter: np.ndarray) -> tuple[np.ndarray, np.ndarray | float]:
        """Forms of a block's trucks, (n, q, q, m) or (q, q, m), from campaigns whose scatter is integrated out."""
        forms = self._forms[..., block.campaigns]
        if not self.data.repeated:
            return forms, 0.0
        _, rows, log_det = integrated(forms, np.sqrt(scatter)[:, :, None] * np.eye(scatter.shape[1]))
        return np.add.reduceat(forms - squared(rows), block.first, axis=-1), log_det.sum(axis=1)

    def _log_prior(self, log_hyper: np.ndarray) -> np.ndarray:
        """Half-Cauchy spreads and scatters, uniform correlations, with the Jacobian of the logarithms."""
        value = np.zeros(len(log_hyper))
        for i, name in enumerate(self.names):
            u = log_hyper[:, i]
            if name.startswith("correlation"):
                # d rho / d log odds is s (1 - s), s the logistic function.
                value += -u - 2.0 * np.log1p(np.exp(-u))
            else:
                scale = self.priors.spread_scale if name.startswith("spread") else self.priors.scatter_scale
                value += u - np.log1p(np.exp(2.0 * (u - np.log(scale))))
        return value

    def draw(self, log_hyper: np.ndarray, random: np.random.Generator) -> Conditional:
        """One draw of the type's mean, shared errors and trucks per row of log hyperparameters (n, h)."""
        log_hyper, d = np.atleast_2d(log_hyper), len(self.data.names)
        beta = np.empty((len(log_hyper), d + self.data.shared_sd.size))
        trucks = np.empty((len(log_hyper), len(self.data.trucks), d))
        numbers = len(log_hyper) * len(self.data.campaigns) * d**2
        pieces = np.array_split(np.arange(len(log_hyper)), max(1, min(len(log_hyper), numbers // _NUMBERS_AT_ONCE)))
        # In this order, whatever works side by side later.
        for at in pieces:
            beta[at] = random.standard_normal((at.size, beta.shape[1]))
            trucks[at] = random.standard_normal((at.size, *trucks.shape[1:]))
        # Rows by importance are drawn again and again.
        different, of = np.unique(log_hyper, axis=0, return_inverse=True)
        sums = self.totals(different)
        factor = np.linalg.cholesky(sums.precision).transpose(0, 2, 1)
        beta = sums.mean[of] + np.linalg.solve(factor[of], beta[..., None])[..., 0]
        known = np.concatenate([beta, np.ones((len(beta), 1))], axis=1)

        def place(row: int) -> None:
            """Trucks in place of their standard normal numbers, for all draws with these hyperparameters."""
            at, root = np.flatnonzero(of == row), self._root(different[row : row + 1])
            for block in self._blocks:
                upper, (rows,), _ = integrated(self._trucks(block, sums.scatter[row : row + 1])[0], root)
                pull = (known[at] @ rows.reshape(len(rows), -1)).reshape(at.size, *rows.shape[1:])
                steps = root @ solved_back(upper, trucks[at, block.trucks].transpose(0, 2, 1) - pull)
                trucks[at, block.trucks] = beta[at, None, :d] + steps.transpose(0, 2, 1)

        side_by_side(place, range(len(different)))
        trucks += self.data.mean
        return Conditional(self.data.mean + beta[:, :d], beta[:, d:], trucks)

    def predicted(self, log_hyper: np.ndarray, totals: Totals, trucks: slice) -> tuple[np.ndarray, np.ndarray]:
        """What all other trucks say of a campaign of each truck: means (n, d, m) and covariances (n, d, d, m).

        Given the hyperparameters, with `totals` of them; shared errors are taken at their mean, as in the draws of the
        campaign.
        """
        d = len(self.data.names)
        (block,) = _blocks(self.data.truck_of, trucks)
        forms, _ = self._trucks(block, totals.scatter)
        forms = forms - squared(integrated(forms, self._root(log_hyper))[1])
        covariance, _ = inverted(totals.precision[..., None] - forms[:, :-1, :-1])
        linear = totals.linear[..., None] + forms[:, :-1, -1]
        mean = np.einsum("nijm,njm->nim", covariance[:, :d], linear)
        covariance = covariance[:, :d, :d] + totals.spread[..., None]
        covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1, 3))
        covariance[:, np.arange(d), np.arange(d)] += totals.scatter[..., None]
        return self.data.mean[:, None] + mean, covariance


@dataclass(frozen=True)
class _Block:
    """Some trucks that follow each other, their `campaigns`, and which of these are each truck's `first`."""

    trucks: slice
    campaigns: slice
    first: np.ndarray


def _blocks(truck_of: np.ndarray, trucks: slice | None = None) -> Iterator[_Block]:
    """Blocks of at most so many campaigns as are computed at once, or the one block of some trucks."""
    first = np.r_[np.flatnonzero(np.r_[True, np.diff(truck_of) > 0]), truck_of.size]
    if trucks is None:
        at = np.searchsorted(first, np.arange(0, truck_of.size, _CAMPAIGNS_AT_ONCE))
        ends = np.unique(np.r_[at, first.size - 1]).tolist()
    else:
        ends = [trucks.start, trucks.stop]
    for begin, end in pairwise(ends):
        yield _Block(slice(begin, end), slice(first[begin], first[end]), first[begin:end] - first[begin])


@dataclass(frozen=True)
class Totals:
    """Sums over all trucks for n sets of hyperparameters, parameters about the mean of their prior.

    `precision` (n, d + S, d + S), `linear` (n, d + S) and `mean` of the type's mean and the shared errors; `constant`
    (n,) of the log-density; covariance `spread` (n, d, d) of trucks, variances `scatter` (n, d) of repeats.
    """

    precision: np.ndarray
    linear: np.ndarray
    mean: np.ndarray
    constant: np.ndarray
    spread: np.ndarray
    scatter: np.ndarray
