"""The population behind the campaigns of a type: mean and spread, every truck drawn towards them, who stands out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from sysid.display import Z90
from sysid.errors import DataRejectedError
from sysid.fleet.draws import CampaignDraws, thinned
from sysid.fleet.exchangeable import Readings, chances, pooled_populations
from sysid.fleet.hierarchy import Hierarchy, HyperPriors, TypeData
from sysid.fleet.likelihood import likelihood_of
from sysid.fleet.population_prior import PopulationPrior, prior_of_others
from sysid.fleet.quadratic_forms import inverted
from sysid.fleet.weights import MOST_K, Weights, campaign_weights, log_corrections, log_ratios, smoothed
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampled_posterior import Posterior
from sysid.posterior.sampling import sample_posterior
from sysid.progress import Progress, unwatched
from sysid.threads import side_by_side

#: Probability, over all trucks and parameters of a type, that a fleet without any outlier has one by chance.
OUTLIER_LEVEL = 0.10
#: Draws of the hyperparameters for everything that follows from them.
DRAWS = 2000
#: Those of them that are weighted by how far the campaigns are from Gaussian: at least so many, and as many more as
#: this number of pairs of a campaign and a draw allows.
_WEIGHTED = 200
_WEIGHTED_PAIRS = 20_000
#: Columns of draws of which quantiles are taken together.
_COLUMNS_AT_ONCE = 200
#: Trucks whose campaigns are weighted together.
_TRUCKS_AT_ONCE = 32
#: Sampling of hyperparameters: a density that takes a millisecond may be drawn from for long.
SAMPLING = SamplingOptions(
    ensembles=4,
    segment_steps=100,
    adapting_steps=0,
    min_steps=300,
    max_steps=6000,
    min_effective=1000.0,
    importance_draws=3000,
    importance_suffices=True,
)

#: Step of the slopes of a log-density by differences.
_STEP = 1e-4


@dataclass(frozen=True)
class Quantiles:
    """Median and ends of a 90 % interval, each (...,), in natural units."""

    q05: np.ndarray
    q50: np.ndarray
    q95: np.ndarray


@dataclass(frozen=True)
class OwnEstimates:
    """Each truck from its own campaigns only, as logarithms; NaN where they do not determine a parameter.

    `value` (trucks, d); `own_sd` (trucks, d) without the errors that campaigns have in common; `common` (trucks, d, S)
    by how much one standard deviation of each of those moves the value.
    """

    value: np.ndarray
    own_sd: np.ndarray
    common: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations (trucks, d), common errors included."""
        return np.asarray(np.sqrt(self.own_sd**2 + (self.common**2).sum(axis=2)))

    def readings(self, parameter: int, truck: int) -> Readings:
        """One parameter of all other trucks that determine it, to be compared with that of a truck."""
        others = np.isfinite(self.value[:, parameter]) & (np.arange(len(self.value)) != truck)
        common = self.common[:, parameter]
        return Readings(
            self.value[others, parameter], self.own_sd[others, parameter] ** 2, common[others], common[truck]
        )


@dataclass(frozen=True)
class Outlier:
    """A truck that is not like the others: `factor` of its median to that of a new truck, `probability` by chance."""

    truck: str
    parameter: str
    factor: float
    probability: float


@dataclass(frozen=True)
class TypePopulation:
    """What the campaigns of one type say.

    - `alone` (trucks, d): each truck from its own campaigns, NaN where they do not determine it; its intervals hold
      shared errors and the scatter of repeats;
    - `trucks` (trucks, d): each truck drawn towards the population;
    - `mean` (d,) of the type;
    - `new` (d,): a truck nobody has measured;
    - `spread` (d,): relative standard deviation between trucks, and `scatter` (d,): that of repeats of one truck (NaN
      if none was repeated);
    - `correlation` (d, d): between parameters;
    - `further` (d,): number of further trucks for half the interval of the mean, inf if a shared error makes this
      impossible.

    `pareto_k` per campaign; `correction_k` of the weights by which all draws were corrected for campaigns that are not
    Gaussian, `corrected` whether they were. `shared`: mean and sd of each.
    """

    type: str
    names: tuple[str, ...]
    quantities: tuple[str, ...]
    units: tuple[str, ...]
    truck_names: tuple[str, ...]
    campaigns: tuple[str, ...]
    alone: Quantiles
    trucks: Quantiles
    mean: Quantiles
    new: Quantiles
    spread: Quantiles
    scatter: Quantiles
    correlation: np.ndarray
    further: np.ndarray
    outliers: tuple[Outlier, ...]
    pareto_k: np.ndarray
    correction_k: float
    corrected: bool
    converged: bool
    message: str
    shared: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    of_others: Mapping[str, PopulationPrior] = field(default_factory=dict)


def fit_population(
    kind: str,
    data: TypeData,
    units: Sequence[str],
    records: Sequence[CampaignDraws | None],
    *,
    shared_names: Sequence[str] = (),
    priors: HyperPriors | None = None,
    sampling: SamplingOptions = SAMPLING,
    progress: Progress | None = None,
) -> TypePopulation:
    """The population of one type.

    Parameters
    ----------
    data : likelihoods of all campaigns.
    records : draws of each campaign, of the parameters it has, for the correction and Pareto k; None for none.
    shared_names : names of the shared errors.

    Raises
    ------
    DataRejectedError
        If there are fewer than three trucks.
    """
    if len(data.trucks) < 3:
        raise DataRejectedError(f"Type '{kind}' has {len(data.trucks)} trucks with results; a population needs three.")
    priors = priors or HyperPriors()
    model = Hierarchy(data, priors)
    posterior, log_hyper = _sampled(model, sampling, progress or unwatched)
    random = np.random.default_rng(sampling.seed)
    k, of_others, correction_k, log_hyper, corrected = _corrected(model, records, log_hyper, random)
    drawn = model.draw(log_hyper, random)
    spread = model.spread(log_hyper)
    tau = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    phi = np.sqrt(model.scatter(log_hyper)) if data.repeated else np.full_like(tau, np.nan)
    alone = stand_alone(data, priors, (phi**2).mean(axis=0) if data.repeated else None)
    return TypePopulation(
        type=kind,
        names=data.names,
        quantities=data.quantities,
        units=tuple(units),
        truck_names=data.trucks,
        campaigns=data.campaigns,
        alone=Quantiles(*(np.exp(alone.value + z * alone.sd) for z in (-Z90, 0.0, Z90))),
        trucks=_quantiles(np.exp(drawn.trucks, out=drawn.trucks)),
        mean=_quantiles(np.exp(drawn.mean)),
        new=_quantiles(np.exp(_new_trucks(drawn.mean, spread, random))),
        spread=_quantiles(tau),
        scatter=_quantiles(phi),
        correlation=(spread / tau[:, :, None] / tau[:, None, :]).mean(axis=0),
        further=further_trucks(drawn.mean, tau, alone.own_sd, drawn.shared),
        outliers=find_outliers(data, stand_alone(data, priors), priors),
        pareto_k=k,
        correction_k=correction_k,
        corrected=corrected,
        converged=posterior.converged,
        message=posterior.message,
        shared={n: (float(e.mean()), float(e.std())) for n, e in zip(shared_names, drawn.shared.T, strict=True)},
        remarks=_remarks(data, k, correction_k, corrected),
        of_others=of_others,
    )


def laplace(model: Hierarchy) -> tuple[np.ndarray, np.ndarray]:
    """Mode (h,) of the hyperparameters and a covariance (h, h) from the curvature there."""
    count = model.start.size
    moves = _STEP * np.eye(count)

    def slope(u: np.ndarray) -> np.ndarray:
        above, below = np.split(model(np.concatenate([u + moves, u - moves])), 2)
        return np.asarray((below - above) / (2.0 * _STEP))

    optimum = minimize(
        lambda u: -float(model(u[None])[0]), model.start, jac=slope, method="BFGS", options={"gtol": 1e-2}
    )
    mode = np.clip(optimum.x, model.start - 4.0, model.start + 4.0)
    step = 0.05
    moves = step * np.eye(count)
    pairs = [(i, j) for i in range(count) for j in range(i, count)]
    points = [mode + s * moves[i] + r * moves[j] for i, j in pairs for s in (1, -1) for r in (1, -1)]
    values = model(np.array(points)).reshape(-1, 4)
    curvature = np.zeros((count, count))
    for (i, j), (pp, pm, mp, mm) in zip(pairs, values, strict=True):
        curvature[i, j] = curvature[j, i] = -(pp - pm - mp + mm) / (4.0 * step**2)
    size, directions = np.linalg.eigh(np.nan_to_num(curvature))
    # Where the density is flat, as towards no spread at all, half a unit of the logarithm is a step that it takes.
    return mode, (directions / np.clip(size, 0.25, None)) @ directions.T


def stand_alone(data: TypeData, priors: HyperPriors, scatter: np.ndarray | None = None) -> OwnEstimates:
    """Each truck from its own campaigns only.

    Campaigns exp(-y'L y/2 + h'y), y = x + A e, with a wide prior of x and e ~ N(0, sd^2): the mean of x moves by B e,
    and its covariance V has the part B diag(sd^2) B'.  It moves by W_c u where the truck was off by u in campaign c.

    Parameters
    ----------
    scatter : variances (d,) of u, which add W_c diag(scatter) W_c' to V; None where they are left to the spread.
    """
    trucks, (d, errors) = len(data.trucks), data.moved.shape[1:]
    # As wide as the prior of the mean where the data say nothing.
    prior = np.diag(np.r_[np.full(d, priors.mean_sd**-2.0), data.shared_sd**-2.0])
    centre_of_prior = np.r_[data.mean, np.zeros(errors)]
    first = np.searchsorted(data.truck_of, np.arange(trucks))
    rows = np.concatenate([np.broadcast_to(np.eye(d), data.precision.shape), data.moved], axis=2)
    pulled = rows.transpose(0, 2, 1) @ data.precision
    likelihood = np.add.reduceat(pulled @ rows, first)
    shift = np.add.reduceat(np.einsum("cij,ci->cj", rows, data.shift), first)
    inverse = np.linalg.inv(likelihood + prior)
    centre = np.einsum("tij,tj->ti", inverse, shift + prior @ centre_of_prior)[:, :d]
    common = inverse[:, :d] @ likelihood[:, :, d:] * data.shared_sd
    variance = np.diagonal(inverse, axis1=1, axis2=2)[:, :d] - (common**2).sum(axis=2)
    unknown = variance >= (0.5 * priors.mean_sd) ** 2
    if scatter is not None:
        moved = (inverse[data.truck_of, :d] @ pulled) ** 2 @ scatter
        variance = variance + np.add.reduceat(moved, first)
    value, own_sd = centre.copy(), np.sqrt(np.maximum(variance, 0.0))
    value[unknown] = own_sd[unknown] = np.nan
    common[unknown] = 0.0
    return OwnEstimates(value, own_sd, common)


def find_outliers(data: TypeData, alone: OwnEstimates, priors: HyperPriors) -> tuple[Outlier, ...]:
    """Trucks whose parameters are further from those of all other trucks than chance explains, the least likely first.

    The level is shared out over all trucks and parameters (Bonferroni).  Errors that trucks have in common explain no
    difference between them as far as they are alike.
    """
    outliers = []
    chance = np.full(alone.value.shape, np.inf)
    alike = {q: [i for i, of in enumerate(data.quantities) if of == q] for q in data.quantities}
    for at in alike.values():
        chance[:, at] = chances(alone.value[:, at], alone.own_sd[:, at] ** 2, alone.common[:, at], priors.spread_scale)
    for t, i in np.argwhere(chance * np.isfinite(alone.value).sum() < OUTLIER_LEVEL):
        at = [j for j in alike[data.quantities[i]] if np.isfinite(np.delete(alone.value[:, j], t)).sum() >= 2]
        pops = pooled_populations([alone.readings(j, t) for j in at], priors.spread_scale)
        factor = float(np.exp(alone.value[t, i] - pops[at.index(i)].quantiles((0.5,))[0]))
        outliers.append(Outlier(data.trucks[t], data.names[i], factor, float(chance[t, i])))
    return tuple(sorted(outliers, key=lambda o: o.probability))


def further_trucks(mean: np.ndarray, tau: np.ndarray, sd: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """How many further trucks, measured as these were, halve the interval of each parameter of the type's mean (d,).

    A truck of spread tau and error s (`sd`, without shared errors) adds information 1/(tau^2 + s^2); half of the width
    needs four times what there is, of which shared errors, that no number of trucks makes smaller, are no part.
    """
    variance = mean.var(axis=0)
    floor = np.zeros(mean.shape[1])
    if shared.shape[1]:
        # The part of the mean that goes with the shared errors.
        centred = shared - shared.mean(axis=0)
        slope = np.linalg.lstsq(centred, mean - mean.mean(axis=0), rcond=None)[0]
        floor = (centred @ slope).var(axis=0)
    of_campaigns = (
        np.nanmedian(np.where(np.isfinite(sd), sd, np.nan) ** 2, axis=0)
        if np.isfinite(sd).any()
        else np.zeros_like(floor)
    )
    wanted = variance / 4.0 - floor
    with np.errstate(divide="ignore", invalid="ignore"):
        count = ((tau**2).mean(axis=0) + of_campaigns) * (1.0 / wanted - 1.0 / (variance - floor))
    return np.where(wanted > 0.0, np.ceil(np.maximum(count, 0.0)), np.inf)


def _sampled(model: Hierarchy, options: SamplingOptions, progress: Progress) -> tuple[Posterior, np.ndarray]:
    """The posterior of the hyperparameters, and draws (n, h) of their logarithms."""
    posterior = sample_posterior(
        model, model.names, *laplace(model), "hierarchy of Gaussian campaigns", options, progress=progress
    )
    return posterior, thinned(np.log(posterior.draws.reshape(-1, len(model.names))), DRAWS)


def _new_trucks(mean: np.ndarray, spread: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A truck of the type for every draw of its mean (n, d) and covariance (n, d, d)."""
    root = np.linalg.cholesky(spread + 1e-18 * np.eye(mean.shape[1]))
    return np.asarray(mean + np.einsum("nij,nj->ni", root, random.standard_normal(mean.shape)))


def _corrected(
    model: Hierarchy, records: Sequence[CampaignDraws | None], log_hyper: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, dict[str, PopulationPrior], float, np.ndarray, bool]:
    """What :func:`_pareto` gives, Pareto k of the correction, and hyperparameters drawn by it if that was possible."""
    weighted = thinned(log_hyper, max(_WEIGHTED, _WEIGHTED_PAIRS // len(model.data.campaigns)))
    k, of_others, log_weights = _pareto(model, records, weighted)
    correction = smoothed(log_weights) if np.ptp(log_weights) > 0.0 else Weights(log_weights, -np.inf)
    if not (np.isfinite(correction.pareto_k) and correction.pareto_k < MOST_K):
        return k, of_others, correction.pareto_k, log_hyper, False
    weights = np.exp(correction.log_weights)
    chosen = random.choice(len(weighted), len(log_hyper), p=weights / weights.sum())
    return k, of_others, correction.pareto_k, weighted[chosen], True


def _pareto(
    model: Hierarchy, records: Sequence[CampaignDraws | None], log_hyper: np.ndarray
) -> tuple[np.ndarray, dict[str, PopulationPrior], np.ndarray]:
    """Pareto k per campaign (NaN without draws), a better prior where it is too large, and log weights (n,)."""
    data, totals = model.data, model.totals(log_hyper)
    blocks = [slice(t, min(t + _TRUCKS_AT_ONCE, len(data.trucks))) for t in range(0, len(data.trucks), _TRUCKS_AT_ONCE)]

    def weigh(trucks: slice) -> tuple[dict[int, float], dict[str, PopulationPrior], np.ndarray]:
        """Those of some trucks; draws of thousands of campaigns need not fit into memory."""
        first, last = np.searchsorted(data.truck_of, [trucks.start, trucks.stop])
        read = {c: record for c in range(first, last) if (record := records[c]) is not None}
        k: dict[int, float] = {}
        priors: dict[str, PopulationPrior] = {}
        log_weights = np.zeros(len(log_hyper))
        if not read:
            return k, priors, log_weights
        means, covariances = model.predicted(log_hyper, totals, trucks)
        for names in dict.fromkeys(record.names for record in read.values()):
            alike = {c: record for c, record in read.items() if record.names == names}
            at, of = [data.names.index(n) for n in names], data.truck_of[list(alike)] - trucks.start
            mean, covariance = means[:, at][..., of], covariances[:, at][:, :, at][..., of]
            precision, log_det = inverted(covariance)
            by_campaign = np.ascontiguousarray(precision.transpose(3, 0, 1, 2))
            ratios = []
            for m, (c, record) in enumerate(alike.items()):
                prior = (record.prior_mean, record.prior_covariance)
                ratios.append(log_ratios(record.draws, prior, mean[..., m], by_campaign[m], log_det[:, m]))
                k[c] = campaign_weights(ratios[-1][::4]).pareto_k
                if k[c] > MOST_K:
                    priors[data.campaigns[c]] = prior_of_others(names, mean[..., m], covariance[..., m])
            # As the draws are: a shared error that was taken out of the likelihood is part of them.
            forms = [likelihood_of(record) for record in alike.values()]
            likelihoods, shifts = (
                np.stack(some, axis=-1) for some in zip(*((f.precision, f.shift) for f in forms), strict=True)
            )
            log_weights += log_corrections(ratios, mean, precision, log_det, likelihoods, shifts).sum(axis=1)
        return k, priors, log_weights

    k, of_others, log_weights = (
        np.full(len(data.campaigns), np.nan),
        dict[str, PopulationPrior](),
        np.zeros(len(log_hyper)),
    )
    for of_block, priors, weights in side_by_side(weigh, blocks):
        k[list(of_block)] = list(of_block.values())
        of_others |= priors
        log_weights += weights
    return k, of_others, log_weights


def _remarks(data: TypeData, k: np.ndarray, correction_k: float, corrected: bool) -> tuple[str, ...]:
    said = []
    bad = [f"{c} ({v:.2f})" for c, v in zip(data.campaigns, k, strict=True) if v > MOST_K]
    if bad:
        said.append(
            f"The draws of {len(bad)} campaigns hardly reach where the population puts their trucks (Pareto k above "
            f"{MOST_K}): {', '.join(bad[:8])}{', ...' if len(bad) > 8 else ''}. Their Gaussian form alone counts "
            "there; 'fleet recalibrate' samples them once more under the population."
        )
    if correction_k > MOST_K and not corrected:
        said.append(
            f"The Gaussian form of the campaigns was not corrected: the weights of that correction have a Pareto k of "
            f"{correction_k:.2f}."
        )
    if not data.repeated:
        said.append("No truck was measured twice: the scatter of repeats is part of the spread between trucks.")
    return tuple(said)


def _quantiles(draws: np.ndarray) -> Quantiles:
    """Of draws (n, ...)."""
    flat = draws.reshape(len(draws), -1)
    # Columns by themselves, some at a time: a copy of all draws of thousands of trucks would double the memory.
    pieces = np.array_split(np.arange(flat.shape[1]), max(1, flat.shape[1] // _COLUMNS_AT_ONCE))
    found = side_by_side(lambda at: np.quantile(np.ascontiguousarray(flat[:, at].T), [0.05, 0.5, 0.95], axis=1), pieces)
    return Quantiles(*np.concatenate(found, axis=1).reshape(3, *draws.shape[1:]))
