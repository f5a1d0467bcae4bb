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

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

#: Numbers of all matrices of one piece of a density's rows: 2 MB each.
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
        self._first = np.flatnonzero(np.r_[True, np.diff(data.truck_of) > 0])
        # About the prior's mean: about zero, sums over many campaigns are so large that a search sees their rounding.
        self._shift = data.shift - np.einsum("cij,j->ci", data.precision, data.mean)

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
        d = len(self.data.names)
        tau = np.exp(log_hyper[:, :d])
        correlation = np.broadcast_to(np.eye(d), (len(log_hyper), d, d)).copy()
        for position, g in enumerate(self._correlated):
            at, rho = self._groups[g], self._correlation(log_hyper[:, d + position], g)
            block = np.broadcast_to(rho[:, None, None], (len(rho), at.size, at.size)).copy()
            block[:, np.arange(at.size), np.arange(at.size)] = 1.0
            correlation[:, at[:, None], at] = block
        return np.asarray(tau[:, :, None] * correlation * tau[:, None, :])

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
            value = np.concatenate([self._log_evidence(piece) for piece in self._pieces(log_hyper)])
            value = value + self._log_prior(log_hyper)
        return np.where(np.isfinite(value), value, -np.inf)

    def _pieces(self, log_hyper: np.ndarray) -> list[np.ndarray]:
        """A few rows at a time: their matrices stay in the cache, and memory does not grow with the number of rows."""
        numbers = len(log_hyper) * len(self.data.campaigns) * len(self.data.names) ** 2
        return np.array_split(log_hyper, max(1, min(len(log_hyper), numbers // _NUMBERS_AT_ONCE)))

    def _log_evidence(self, log_hyper: np.ndarray) -> np.ndarray:
        parts = self.parts(log_hyper)
        return np.asarray(
            parts.constant + 0.5 * np.einsum("nb,nb->n", parts.totals.linear, parts.mean) - 0.5 * parts.log_det
        )

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
        drawn = [self._drawn(piece, random) for piece in self._pieces(np.atleast_2d(log_hyper))]
        return Conditional(*(np.concatenate([getattr(d, f.name) for d in drawn]) for f in fields(Conditional)))

    def _drawn(self, log_hyper: np.ndarray, random: np.random.Generator) -> Conditional:
        n, d = len(log_hyper), len(self.data.names)
        parts = self.parts(log_hyper)
        factor = np.linalg.cholesky(parts.totals.precision)
        noise = random.standard_normal((n, parts.mean.shape[1], 1))
        beta = parts.mean + np.linalg.solve(factor.transpose(0, 2, 1), noise)[..., 0]
        mean, shared = beta[:, :d], beta[:, d:]
        trucks = parts.truck_mean(mean, shared)
        root = np.linalg.cholesky(parts.totals.spread + 1e-18 * np.eye(d))
        inner = np.eye(d) + np.einsum("nij,ntik,nkl->ntjl", root, parts.trucks.precision, root, optimize=True)
        steps = np.linalg.solve(
            np.linalg.cholesky(inner).transpose(0, 1, 3, 2), random.standard_normal((*trucks.shape, 1))
        )
        trucks = trucks + np.einsum("nij,ntj->nti", root, steps[..., 0])
        return Conditional(self.data.mean + mean, shared, self.data.mean + trucks)

    def totals(self, log_hyper: np.ndarray) -> Totals:
        """What :meth:`predicted` needs of log hyperparameters (n, h)."""
        pieces = [self.parts(piece).totals for piece in self._pieces(log_hyper)]
        return Totals(*(np.concatenate([getattr(p, f.name) for p in pieces]) for f in fields(Totals)))

    def predicted(self, log_hyper: np.ndarray, totals: Totals, truck: int) -> tuple[np.ndarray, np.ndarray]:
        """What all other trucks say of a campaign of one truck: means (n, d) and covariances (n, d, d).

        Given the hyperparameters, with `totals` of them; shared errors are taken at their mean, as in the draws of the
        campaign.
        """
        d = len(self.data.names)
        joint = totals.precision - totals.joint_of_truck[:, truck]
        linear = totals.linear - totals.linear_of_truck[:, truck]
        mean = np.linalg.solve(joint, linear[..., None])[..., 0][:, :d]
        covariance = np.linalg.inv(joint)[:, :d, :d] + totals.spread
        covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
        covariance[:, np.arange(d), np.arange(d)] += self.scatter(log_hyper)
        return self.data.mean + mean, covariance

    def parts(self, log_hyper: np.ndarray) -> Parts:
        """Sums over campaigns and trucks for log hyperparameters (n, h)."""
        data, d = self.data, len(self.data.names)
        spread, scatter = self.spread(log_hyper), self.scatter(log_hyper)
        # Campaigns with their scatter integrated out: (I + L Phi)^-1 L and (I + L Phi)^-1 h.
        mixed = np.eye(d) + data.precision * scatter[:, None, None, :]
        inverse = np.linalg.inv(mixed)
        precision, shift = inverse @ data.precision, np.einsum("ncij,cj->nci", inverse, self._shift)
        constant = 0.5 * np.einsum("ci,ni,nci->n", self._shift, scatter, shift)
        constant -= 0.5 * np.linalg.slogdet(mixed)[1].sum(axis=1)
        campaigns = Forms(
            precision,
            shift,
            precision @ data.moved,
            np.einsum("cis,ncij->ncsj", data.moved, precision) @ data.moved,
            np.einsum("cis,nci->ncs", data.moved, shift),
        )
        trucks = campaigns.summed(self._first)
        # theta integrated out: G = (I + L T)^-1.
        mixed = trucks.mixed(spread)
        gain = np.linalg.inv(mixed)
        pulled = np.einsum("ntij,ntj->nti", gain, trucks.shift)
        constant += 0.5 * np.einsum("nti,nij,ntj->n", trucks.shift, spread, pulled, optimize=True)
        constant -= 0.5 * np.linalg.slogdet(mixed)[1].sum(axis=1)
        joint, linear = trucks.joint(spread, gain), trucks.linear(spread, pulled)
        prior = np.r_[np.full(d, self.priors.mean_sd**-2.0), data.shared_sd**-2.0]
        whole = joint.sum(axis=1)
        whole = 0.5 * (whole + whole.transpose(0, 2, 1)) + np.diag(prior)
        pull = linear.sum(axis=1)
        mean = np.linalg.solve(whole, pull[..., None])[..., 0]
        return Parts(constant, mean, trucks, gain, Totals(whole, pull, spread, joint, linear))


@dataclass(frozen=True)
class Forms:
    """Quadratic forms of campaigns, or of trucks, in theta (d,) and the shared errors e (S,).

    exp(-theta'L theta/2 + h'theta - theta'B e - e'D e/2 + g'e): `precision` L (n, m, d, d), `shift` h (n, m, d),
    `moved` B (n, m, d, S), `shared` D (n, m, S, S), `shared_shift` g (n, m, S).
    """

    precision: np.ndarray
    shift: np.ndarray
    moved: np.ndarray
    shared: np.ndarray
    shared_shift: np.ndarray

    def summed(self, first: np.ndarray) -> Forms:
        """Trucks, from campaigns of which each truck's first is named."""
        parts = (self.precision, self.shift, self.moved, self.shared, self.shared_shift)
        return Forms(*(np.add.reduceat(part, first, axis=1) for part in parts))

    def mixed(self, spread: np.ndarray) -> np.ndarray:
        """I + L T for covariances T (n, d, d) of theta."""
        return np.asarray(np.eye(spread.shape[-1]) + self.precision @ spread[:, None])

    def joint(self, spread: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Precision (n, m, d + S, d + S) of mu and e with theta ~ N(mu, T) integrated out; G = (I + L T)^-1."""
        cross = gain @ self.moved
        corner = self.shared - self.moved.transpose(0, 1, 3, 2) @ spread[:, None] @ cross
        upper = np.concatenate([gain @ self.precision, cross], axis=3)
        return np.concatenate([upper, np.concatenate([cross.transpose(0, 1, 3, 2), corner], axis=3)], axis=2)

    def linear(self, spread: np.ndarray, pulled: np.ndarray) -> np.ndarray:
        """Linear term (n, m, d + S) of the same, from G h (n, m, d)."""
        of_shared = self.shared_shift - np.einsum("ntis,nij,ntj->nts", self.moved, spread, pulled)
        return np.concatenate([pulled, of_shared], axis=2)


@dataclass(frozen=True)
class Totals:
    """Precision (n, d + S, d + S) and linear term (n, d + S) of mean and shared errors, T (n, d, d), and of trucks.

    Parameters are about the mean of their prior.
    """

    precision: np.ndarray
    linear: np.ndarray
    spread: np.ndarray
    joint_of_truck: np.ndarray
    linear_of_truck: np.ndarray


@dataclass(frozen=True)
class Parts:
    """Sums of the model for n sets of hyperparameters: all that density, draws and predictions need.

    `gain` (n, trucks, d, d) is (I + L T)^-1 of every truck.
    """

    constant: np.ndarray
    mean: np.ndarray
    trucks: Forms
    gain: np.ndarray
    totals: Totals

    @property
    def log_det(self) -> np.ndarray:
        """Logarithm of the determinant of the precision of mean and shared errors, (n,)."""
        return np.asarray(np.linalg.slogdet(self.totals.precision)[1])

    def truck_mean(self, mean: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """Means (n, trucks, d) of the trucks given the type's mean (n, d) and shared errors (n, S)."""
        data = self.trucks.shift - np.einsum("ntis,ns->nti", self.trucks.moved, shared)
        towards = np.einsum("ntji,nj->nti", self.gain, mean)
        return np.asarray(towards + np.einsum("nij,ntjk,ntk->nti", self.totals.spread, self.gain, data, optimize=True))
