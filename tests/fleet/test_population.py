"""The hierarchy of Gaussian campaigns: closed forms, certified posteriors, a sampler of everything at once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from sysid.errors import DataRejectedError
from sysid.fleet import hierarchy
from sysid.fleet.draws import CampaignDraws, read_draws, thinned, write_draws
from sysid.fleet.exchangeable import Population, Readings, evidence, pooled_populations, population
from sysid.fleet.hierarchy import Hierarchy, HyperPriors, TypeData
from sysid.fleet.likelihood import likelihood_of, without_shared
from sysid.fleet.population import find_outliers, fit_population, laplace, stand_alone
from sysid.fleet.weights import campaign_weights, log_ratios
from sysid.posterior.options import SamplingOptions

POSTERIORDB = Path(__file__).resolve().parents[1] / "data" / "posteriordb"
SHORT = SamplingOptions(
    ensembles=4, segment_steps=100, adapting_steps=0, min_steps=200, max_steps=2000, min_effective=1000.0
)


def spd(random: np.random.Generator, d: int, scale: float) -> np.ndarray:
    a = random.standard_normal((d, d + 2)) * scale
    return a @ a.T / d


def small_fleet(
    seed: int = 3, trucks: int = 5, d: int = 3, shared: bool = True
) -> tuple[TypeData, np.ndarray, np.ndarray]:
    """Campaigns with full covariances, one truck with a single one: data, values (C, d) and covariances (C, d, d)."""
    random = np.random.default_rng(seed)
    truck_of = np.array([t for t in range(trucks) for _ in range(1 if t == 1 else 2)])
    covariance = np.array([spd(random, d, 0.08) for _ in truck_of])
    truck = 0.3 + 0.15 * random.standard_normal((trucks, d))
    value = np.array([random.multivariate_normal(truck[t], c) for t, c in zip(truck_of, covariance, strict=True)])
    precision = np.linalg.inv(covariance)
    moved = np.zeros((len(truck_of), d, 2 if shared else 0))
    if shared:
        moved[:5, :, 0], moved[3:, :2, 1] = 1.0, -0.5
    data = TypeData(
        (*(f"k_{i + 1}" for i in range(d - 1)), "c_1"),
        ("stiffness",) * (d - 1) + ("damping",),
        tuple(f"T{t}" for t in range(trucks)),
        tuple(f"C{c}" for c in range(len(truck_of))),
        truck_of,
        precision,
        np.einsum("cij,cj->ci", precision, value),
        np.full(d, 0.2),
        moved,
        np.array([0.05, 0.1] if shared else []),
    )
    return data, value, covariance


def dense(model: Hierarchy, log_hyper: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Prior covariance of (mu, e, theta, y), mean of it, and where y begins: everything written out."""
    data = model.data
    d, s, trucks, campaigns = len(data.names), data.shared_sd.size, len(data.trucks), len(data.campaigns)
    spread, scatter = model.spread(log_hyper[None])[0], model.scatter(log_hyper[None])[0]
    roots = [np.eye(d) * model.priors.mean_sd, np.diag(data.shared_sd)]
    roots += [np.linalg.cholesky(spread)] * trucks
    roots += [np.linalg.cholesky(np.diag(scatter) + c + 1e-30 * np.eye(d)) for c in covariance]
    sizes = [r.shape[0] for r in roots]
    ends = np.cumsum(sizes)
    source = np.zeros((sum(sizes), sum(sizes)))
    for root, end in zip(roots, ends, strict=True):
        source[end - len(root) : end, end - len(root) : end] = root
    mix = np.zeros((d + s + trucks * d + campaigns * d, sum(sizes)))
    mix[:d], mix[d : d + s] = source[:d], source[d : d + s]
    for t in range(trucks):
        at = d + s + t * d
        mix[at : at + d] = source[:d] + source[at : at + d]
    for c in range(campaigns):
        at = d + s + (trucks + c) * d
        own = d + s + data.truck_of[c] * d
        mix[at : at + d] = mix[own : own + d] + data.moved[c] @ source[d : d + s] + source[at : at + d]
    centre = np.zeros(len(mix))
    for at in [0, *range(d + s, len(mix), d)]:
        centre[at : at + d] = data.mean
    return mix @ mix.T, centre, np.arange(d + s + trucks * d, len(mix))


@pytest.mark.parametrize("shared", [False, True])
def test_density_and_draws_are_those_of_the_dense_gaussian(shared: bool) -> None:
    data, value, covariance = small_fleet(shared=shared)
    model = Hierarchy(data, HyperPriors(mean_sd=1.5))
    random = np.random.default_rng(0)
    points = model.start + 0.5 * random.standard_normal((4, model.start.size))
    found, expected = [], []
    for point in points:
        joint, centre, y = dense(model, point, covariance)
        expected.append(multivariate_normal(centre[y], joint[np.ix_(y, y)]).logpdf(value.ravel()))
        found.append(model(point[None])[0] - model._log_prior(point[None])[0])
    # The likelihoods are known up to constants, which are the same at every point.
    assert np.ptp(np.array(found) - expected) < 1e-8
    assert np.ptp(expected) > 1.0
    point = points[0]
    joint, centre, y = dense(model, point, covariance)
    x = np.arange(y[0])
    gain = joint[np.ix_(x, y)] @ np.linalg.inv(joint[np.ix_(y, y)])
    mean = centre[x] + gain @ (value.ravel() - centre[y])
    sd = np.sqrt(np.diag(joint[np.ix_(x, x)] - gain @ joint[np.ix_(y, x)]))
    drawn = model.draw(np.tile(point, (20_000, 1)), random)
    together = np.hstack([drawn.mean, drawn.shared, drawn.trucks.reshape(20_000, -1)])
    assert np.abs((together.mean(axis=0) - mean) / sd).max() < 0.035
    assert np.abs(together.std(axis=0) / sd - 1.0).max() < 0.025


def test_hyperparameters_are_what_their_names_say() -> None:
    data, _, _ = small_fleet(shared=False)
    model = Hierarchy(data, HyperPriors())
    assert model.names == (
        "spread[k_1]", "spread[k_2]", "spread[c_1]", "correlation_odds[stiffness]", "scatter[stiffness]",
        "scatter[damping]",
    )  # fmt: skip
    # Odds of 3: of two axles the correlation is from -1 to 1, here three quarters of the way.
    point = np.log([[0.1, 0.2, 0.3, 3.0, 0.04, 0.05]])
    expected = np.array([[0.01, 0.5 * 0.02, 0.0], [0.5 * 0.02, 0.04, 0.0], [0.0, 0.0, 0.09]])
    assert model.spread(point)[0] == pytest.approx(expected, rel=1e-5)
    assert model.scatter(point)[0] == pytest.approx([0.04**2, 0.04**2, 0.05**2])


def test_what_the_other_trucks_say_of_a_campaign_is_the_dense_conditional() -> None:
    data, value, covariance = small_fleet(shared=False)
    model = Hierarchy(data, HyperPriors(mean_sd=1.5))
    for campaign in (1, 2):
        joint, centre, y = dense(
            model, model.start, 1e-30 * np.eye(3) + np.where(np.arange(9)[:, None, None] == campaign, 0.0, covariance)
        )
        truck = data.truck_of[campaign]
        others = y[np.repeat(data.truck_of != truck, 3)]
        own = y[np.repeat(np.arange(9) == campaign, 3)]
        gain = joint[np.ix_(own, others)] @ np.linalg.inv(joint[np.ix_(others, others)])
        mean = centre[own] + gain @ (value.ravel()[others - y[0]] - centre[others])
        known = joint[np.ix_(own, own)] - gain @ joint[np.ix_(others, own)]
        totals = model.totals(model.start[None])
        found_mean, found = model.predicted(model.start[None], totals, slice(truck, truck + 1))
        assert found_mean[0, :, 0] == pytest.approx(mean, abs=1e-9)
        assert found[0, ..., 0] == pytest.approx(known, abs=1e-10)


def test_fleets_of_several_blocks_are_those_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    data, _, _ = small_fleet(trucks=9)
    model = Hierarchy(data, HyperPriors())
    points = model.start + 0.3 * np.random.default_rng(0).standard_normal((7, model.start.size))
    points[5] = points[2]
    whole = model(points), model.draw(points, np.random.default_rng(1)).trucks
    monkeypatch.setattr(hierarchy, "_CAMPAIGNS_AT_ONCE", 4)
    monkeypatch.setattr(hierarchy, "_PAIRS_AT_ONCE", 5)
    blocks = Hierarchy(data, HyperPriors())
    assert len(blocks._blocks) > 3
    assert blocks(points) == pytest.approx(whole[0], abs=1e-9)
    assert blocks.draw(points, np.random.default_rng(1)).trucks == pytest.approx(whole[1], abs=1e-12)


def test_no_spread_and_silent_campaigns_are_finite() -> None:
    data, _, _ = small_fleet()
    precision = data.precision.copy()
    precision[0] = 0.0
    shift = data.shift.copy()
    shift[0] = 0.0
    quiet = TypeData(
        data.names, data.quantities, data.trucks, data.campaigns, data.truck_of, precision, shift, data.mean,
        data.moved, data.shared_sd,
    )  # fmt: skip
    model = Hierarchy(quiet, HyperPriors())
    points = np.tile(model.start, (2, 1))
    points[1, :3] = -25.0
    assert np.isfinite(model(points)).all()
    assert np.isfinite(model.draw(points, np.random.default_rng(0)).trucks).all()


def test_eight_schools_are_those_of_posteriordb() -> None:
    schools = json.loads((POSTERIORDB / "eight_schools.data.json").read_text())
    name = "eight_schools-eight_schools_noncentered.reference_summary.json"
    reference = json.loads((POSTERIORDB / name).read_text())
    y, sigma = np.array(schools["y"], float), np.array(schools["sigma"], float)
    data = TypeData(
        ("effect",), ("effect",), tuple("ABCDEFGH"), tuple("ABCDEFGH"), np.arange(8),
        (sigma**-2.0)[:, None, None], (y * sigma**-2.0)[:, None], np.zeros(1),
    )  # fmt: skip
    model = Hierarchy(data, HyperPriors(mean_sd=5.0, spread_scale=5.0))
    fitted = sampled(model, 4000)
    drawn = model.draw(fitted, np.random.default_rng(0))
    tau = np.exp(fitted[:, 0])
    schools_too = [(drawn.trucks[:, i, 0], f"theta[{i + 1}]") for i in range(8)]
    for found, key in [(drawn.mean[:, 0], "mu"), (tau, "tau"), *schools_too]:
        mean, sd = reference[key]["mean"], reference[key]["sd"]
        assert abs(found.mean() - mean) < 0.1 * sd, key
        assert 0.9 < found.std() / sd < 1.1, key


def sampled(model: Hierarchy, count: int) -> np.ndarray:
    """Draws (count, h) of the log hyperparameters by the sampler of the product."""
    from sysid.fleet.population import laplace
    from sysid.posterior.sampling import sample_posterior

    options = SamplingOptions(
        ensembles=4, segment_steps=200, adapting_steps=0, min_steps=600, max_steps=6000, min_effective=2500.0
    )
    posterior = sample_posterior(model, model.names, *laplace(model), "test", options)
    assert posterior.converged, posterior.message
    draws = np.log(posterior.draws.reshape(-1, len(model.names)))
    return draws[np.linspace(0, len(draws) - 1, count).astype(int)]


def gibbs(data: TypeData, priors: HyperPriors, steps: int, chains: int, seed: int) -> dict[str, np.ndarray]:
    """Everything at once: type mean, trucks, campaigns, spreads and scatter in turn, each from its own conditional."""
    random = np.random.default_rng(seed)
    d, trucks, campaigns = len(data.names), len(data.trucks), len(data.campaigns)
    mu, theta = np.tile(data.mean, (chains, 1)), np.zeros((chains, trucks, d))
    tau, phi = np.full((chains, d), 0.1), np.full((chains, d), 0.05)
    kept: dict[str, list[np.ndarray]] = {"mean": [], "trucks": [], "spread": [], "scatter": []}
    belongs = np.eye(trucks)[data.truck_of]
    count = belongs.sum(axis=0)

    def grid_draw(squares: np.ndarray, n: int, scale: float) -> np.ndarray:
        sd = scale * np.exp(np.linspace(-6.0, 3.5, 400))
        log = -n * np.log(sd) - 0.5 * squares[..., None] / sd**2 + np.log(sd) - np.log1p((sd / scale) ** 2)
        weights = np.exp(log - log.max(axis=-1, keepdims=True)).cumsum(axis=-1)
        at = (weights < random.uniform(size=(*squares.shape, 1)) * weights[..., -1:]).sum(axis=-1)
        return sd[at]

    for step in range(steps):
        whole = data.precision + np.einsum("nd,de->nde", phi**-2, np.eye(d))[:, None]
        pull = data.shift + (theta / phi[:, None] ** 2)[:, data.truck_of]
        root = np.linalg.cholesky(np.linalg.inv(whole))
        x = np.linalg.solve(whole, pull[..., None])[..., 0]
        x = x + np.einsum("ncij,ncj->nci", root, random.standard_normal((chains, campaigns, d)))
        weight = count[:, None] / phi[:, None] ** 2 + tau[:, None] ** -2
        centre = np.einsum("ct,ncd->ntd", belongs, x) / phi[:, None] ** 2 + (mu / tau**2)[:, None]
        theta = centre / weight + random.standard_normal(theta.shape) / np.sqrt(weight)
        weight = trucks / tau**2 + priors.mean_sd**-2
        mu = (theta.sum(axis=1) / tau**2 + data.mean * priors.mean_sd**-2) / weight
        mu = mu + random.standard_normal(mu.shape) / np.sqrt(weight)
        tau = grid_draw(((theta - mu[:, None]) ** 2).sum(axis=1), trucks, priors.spread_scale)
        off = ((x - theta[:, data.truck_of]) ** 2).sum(axis=1)
        for quantity in dict.fromkeys(data.quantities):
            at = [i for i, q in enumerate(data.quantities) if q == quantity]
            phi[:, at] = grid_draw(off[:, at].sum(axis=1), campaigns * len(at), priors.scatter_scale)[:, None]
        if step >= steps // 5:
            for name, values in (("mean", mu), ("trucks", theta), ("spread", tau), ("scatter", phi)):
                kept[name].append(values.reshape(chains, -1).copy())
    return {name: np.concatenate(values) for name, values in kept.items()}


def test_two_stages_give_what_sampling_everything_at_once_gives() -> None:
    data, _, _ = small_fleet(seed=5, trucks=6, d=2, shared=False)
    priors = HyperPriors(correlated=False)
    model = Hierarchy(data, priors)
    log_hyper = sampled(model, 8000)
    drawn = model.draw(log_hyper, np.random.default_rng(1))
    found = {
        "mean": drawn.mean,
        "trucks": drawn.trucks.reshape(len(log_hyper), -1),
        "spread": np.exp(log_hyper[:, :2]),
        "scatter": np.sqrt(model.scatter(log_hyper)),
    }
    expected = gibbs(data, priors, 1500, 50, 2)
    for name, draws in found.items():
        sd = expected[name].std(axis=0)
        assert np.abs((draws.mean(axis=0) - expected[name].mean(axis=0)) / sd).max() < 0.1, name
        assert np.all((draws.std(axis=0) / sd > 0.9) & (draws.std(axis=0) / sd < 1.1)), name


def record(
    random: np.random.Generator, mean: np.ndarray, covariance: np.ndarray, names: tuple[str, ...]
) -> CampaignDraws:
    """Draws of a campaign whose likelihood is N(mean, covariance), made under a prior."""
    d = len(names)
    prior = np.diag(np.linspace(0.4, 0.8, d) ** 2)
    if d > 1:
        prior[0, 1] = prior[1, 0] = 0.1
    whole = np.linalg.inv(np.linalg.inv(prior) + np.linalg.inv(covariance))
    centre = whole @ (np.linalg.solve(prior, np.full(d, 0.5)) + np.linalg.solve(covariance, mean))
    draws = random.multivariate_normal(centre, whole, 1000)
    kinds = tuple("damping" if n.startswith("c") else "stiffness" for n in names)
    return CampaignDraws(names, kinds, ("1",) * d, (0,) * d, ("",) * d, ("linear",) * d, draws, np.full(d, 0.5), prior)


def test_dividing_the_prior_out_leaves_the_likelihood() -> None:
    random = np.random.default_rng(4)
    mean, covariance = np.array([0.1, -0.2, 0.4]), spd(random, 3, 0.1)
    found = likelihood_of(record(random, mean, covariance, ("k_1", "k_2", "c_1")))
    assert np.linalg.inv(found.precision) == pytest.approx(covariance, rel=0.15, abs=0.1 * covariance.max())
    assert np.linalg.solve(found.precision, found.shift) == pytest.approx(mean, abs=0.2 * np.sqrt(covariance.max()))
    one = likelihood_of(record(random, mean[:1], covariance[:1, :1], ("k_1",)))
    assert 1.0 / one.precision == pytest.approx(covariance[:1, :1], rel=0.15)
    # Draws of the prior alone say nothing, though by chance their covariance is not exactly the prior's.
    wide = record(random, mean, 1e8 * np.eye(3), ("k_1", "k_2", "c_1"))
    silent = likelihood_of(wide)
    assert np.linalg.eigvalsh(silent.precision).min() >= -1e-12
    assert np.abs(np.sqrt(np.diag(silent.precision)) * 0.4).max() < 0.6


def test_a_shared_error_is_taken_out_of_the_interval_that_holds_it() -> None:
    covariance, moved, sd = np.diag([0.01, 0.02, 0.04]) ** 2, np.array([1.0, 1.0, 0.0]), 0.008
    whole = covariance + sd**2 * np.outer(moved, moved)
    mean = np.array([1.0, 2.0, 3.0])
    from sysid.fleet.likelihood import Likelihood

    precision = np.linalg.inv(whole)
    found, share = without_shared(Likelihood(precision, precision @ mean), moved, sd)
    assert np.linalg.inv(found.precision) == pytest.approx(covariance, abs=1e-12)
    assert np.linalg.solve(found.precision, found.shift) == pytest.approx(mean)
    assert 0.0 < share < 1.0
    # An interval that cannot hold the error is not made negative.
    capped, share = without_shared(Likelihood(precision, precision @ mean), moved, 1.0)
    assert share > 1.0
    assert np.linalg.eigvalsh(capped.precision).min() > 0.0


def test_a_shared_error_does_not_shrink_with_more_trucks() -> None:
    names, trucks = ("k_1",), 30
    value = 0.02 * np.random.default_rng(0).standard_normal(trucks)
    precision = np.full((trucks, 1, 1), 0.02**-2.0)
    moved = np.ones((trucks, 1, 1))
    data = TypeData(
        names, ("stiffness",), tuple(map(str, range(trucks))), tuple(map(str, range(trucks))), np.arange(trucks),
        precision, precision[:, 0] * value[:, None], np.zeros(1), moved, np.array([0.05]),
    )  # fmt: skip
    fitted = fit_population("t", data, ("N/m",), [None] * trucks, shared_names=("scales",), sampling=SHORT)
    width = np.log(fitted.mean.q95 / fitted.mean.q05)[0] / 3.29
    assert width == pytest.approx(0.05, rel=0.1)
    assert fitted.further[0] == np.inf
    mean, sd = fitted.shared["scales"]
    assert abs(mean) < 0.01
    assert sd == pytest.approx(0.05, rel=0.1)


def test_draws_are_kept_and_read_back(tmp_path: Path) -> None:
    kept = record(np.random.default_rng(0), np.zeros(2), 0.01 * np.eye(2), ("k_1", "c_1"))
    write_draws(tmp_path / "draws.npz", kept)
    back = read_draws(tmp_path / "draws.npz")
    assert back is not None
    assert back.names == kept.names
    assert np.array_equal(back.draws, kept.draws)
    assert back.of(("c_1",)).prior_covariance.tolist() == [[kept.prior_covariance[1, 1]]]
    (tmp_path / "draws.npz").write_bytes(b"damaged")
    assert read_draws(tmp_path / "draws.npz") is None
    assert thinned(np.arange(20.0)[:, None], 5)[:, 0].tolist() == [0.0, 4.0, 9.0, 14.0, 19.0]


def test_pareto_k_tells_draws_that_do_not_reach() -> None:
    random = np.random.default_rng(7)
    kept = record(random, np.zeros(2), 0.01 * np.eye(2), ("k_1", "c_1"))

    def weights(mean: list[float], variance: float):
        others = np.array([mean]), np.eye(2)[None] / variance, 2.0 * np.log([variance])
        return campaign_weights(log_ratios(kept.draws, (kept.prior_mean, kept.prior_covariance), *others))

    near, far = weights([0.0, 0.0], 1.0), weights([-0.6, -0.6], 0.0004)
    assert near.pareto_k < 0.5
    assert far.pareto_k > 0.7
    # Reweighted to another Gaussian, a product of Gaussians is known in closed form.
    moved = weights([0.1, 0.0], 0.04)
    assert moved.mean(kept.draws)[0] == pytest.approx(0.1 * 0.01 / 0.05, abs=0.01)


def test_ratios_of_many_gaussians_are_those_of_scipy() -> None:
    random = np.random.default_rng(3)
    x, mean = 13.0 + 0.02 * random.standard_normal((40, 3)), 13.0 + 0.03 * random.standard_normal((5, 3))
    root = 0.01 * random.standard_normal((5, 3, 3)) + 0.02 * np.eye(3)
    covariance = root @ root.transpose(0, 2, 1)
    prior = multivariate_normal(mean[0] + 0.3, 0.09 * np.eye(3))
    oracle = [multivariate_normal(m, c).logpdf(x) - prior.logpdf(x) for m, c in zip(mean, covariance, strict=True)]
    others = mean, np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]
    found = log_ratios(x, (mean[0] + 0.3, 0.09 * np.eye(3)), *others)
    np.testing.assert_allclose(found, oracle, rtol=1e-9, atol=1e-9)


def test_one_number_per_truck_by_quadrature() -> None:
    y, s2 = np.array([0.1, -0.2, 0.05, 0.3, 0.0]), np.full(5, 0.01)
    found = population(Readings.independent(y, s2), 0.2)
    assert found.weights.sum() == pytest.approx(1.0)
    # Where the readings are exact and the spread is known, a new truck is normal about their mean.
    exact = Population(np.ones(1), np.array([0.1]), np.array([0.5]), np.array([0.1**2 / 5]))
    assert exact.quantiles((0.95,))[0] == pytest.approx(0.5 + 1.6448536 * 0.1 * np.sqrt(1.2), abs=1e-8)
    assert exact.tail(0.5 + 0.1 * np.sqrt(1.2 + 1.0) * 1.959964, 0.01) == pytest.approx(0.05, abs=1e-5)
    (single,) = pooled_populations([Readings.independent(y, s2)], 0.2)
    assert single.weights == pytest.approx(found.weights)
    # Like parameters that vary more raise the spread of one that says little of its own.
    pooled = pooled_populations([Readings.independent(f * y, s2) for f in (1.0, 10.0, -8.0)], 0.2)
    assert pooled[0].weights @ pooled[0].spread > found.weights @ found.spread


def test_two_trucks_are_no_population() -> None:
    data, _, _ = small_fleet(trucks=2, shared=False)
    with pytest.raises(DataRejectedError, match="a population needs three"):
        fit_population("t", data, ("1",) * 3, [None] * 3)


@pytest.mark.parametrize("spread", [0.001, 0.01, 0.1])
def test_quantiles_of_a_narrow_population_are_those_of_its_distribution(spread: float) -> None:
    y = 0.6 + spread * np.random.default_rng(0).standard_normal(6)
    found = population(Readings.independent(y, np.full(6, (0.5 * spread) ** 2)), 0.1)
    levels = (0.05, 0.5, 0.95)
    sd = np.sqrt(found.variance + found.spread**2)
    reached = [found.weights @ norm.cdf(q, found.mean, sd) for q in found.quantiles(levels)]
    assert reached == pytest.approx(levels, abs=1e-8)


def test_a_truck_far_above_is_as_unlikely_as_one_far_below() -> None:
    of = Population(np.ones(3) / 3, np.full(3, 0.01), np.zeros(3), np.zeros(3))
    for reading in (0.13, -0.13):
        assert of.tail(reading, 0.01**2) == pytest.approx(2.0 * norm.sf(0.13 / np.hypot(0.01, 0.01)), rel=1e-10)


def test_readings_with_errors_in_common_are_those_of_generalised_least_squares() -> None:
    """Mean and variance of the best linear unbiased prediction, and the restricted likelihood, from the dense V."""
    random = np.random.default_rng(2)
    value, variance = random.normal(0.3, 0.2, 6), random.uniform(0.01, 0.04, 6) ** 2
    common, of_new = 0.1 * random.standard_normal((6, 2)), np.array([0.08, -0.05])
    spread, ones = np.array([0.02, 0.1, 0.4]), np.ones(6)
    log, mean, var = evidence(Readings(value, variance, common, of_new), spread)
    shared = common @ of_new
    dense = []
    for g, tau in enumerate(spread):
        whole = common @ common.T + np.diag(variance + tau**2)
        known = ones @ np.linalg.solve(whole, ones)
        centre = ones @ np.linalg.solve(whole, value) / known
        left = np.linalg.solve(whole, value - centre)
        assert mean[g] == pytest.approx(centre + shared @ left, rel=1e-10)
        unexplained = 1.0 - ones @ np.linalg.solve(whole, shared)
        expected = of_new @ of_new - shared @ np.linalg.solve(whole, shared) + unexplained**2 / known
        assert var[g] == pytest.approx(expected, rel=1e-10)
        dense.append(-0.5 * (np.linalg.slogdet(whole)[1] + np.log(known) + (value - centre) @ left))
    # Up to constants.
    np.testing.assert_allclose(log - log[0], np.array(dense) - dense[0], rtol=1e-10)


def test_a_truck_by_itself_has_the_shared_errors_of_its_campaigns() -> None:
    """Both campaigns of a truck written out as one Gaussian with the errors in it."""
    data, value, covariance = small_fleet()
    priors = HyperPriors(mean_sd=1.5)
    found = stand_alone(data, priors)
    for truck in range(len(data.trucks)):
        of = np.flatnonzero(data.truck_of == truck)
        rows = np.tile(np.eye(3), (len(of), 1))
        noise = np.zeros((rows.shape[0], rows.shape[0]))
        for i, c in enumerate(of):
            noise[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = covariance[c]
        moved = np.concatenate([data.moved[c] for c in of]) * data.shared_sd
        prior = priors.mean_sd**2 * np.eye(3)
        gain = prior @ rows.T @ np.linalg.inv(rows @ prior @ rows.T + moved @ moved.T + noise)
        y = np.concatenate([value[c] for c in of])
        assert found.value[truck] == pytest.approx(data.mean + gain @ (y - rows @ data.mean), abs=1e-9)
        assert found.sd[truck] ** 2 == pytest.approx(np.diag(prior - gain @ rows @ prior), rel=1e-9)
        assert found.common[truck] == pytest.approx(gain @ moved, abs=1e-9)
        # A truck that is off by u on the day of a campaign: the value follows as the gain says.
        scatter = np.array([0.01, 0.04, 0.09])
        by_day = stand_alone(data, priors, scatter).own_sd[truck] ** 2 - found.own_sd[truck] ** 2
        assert by_day == pytest.approx((gain**2) @ np.tile(scatter, len(of)), rel=1e-9)


def fleet_of_one_number(random: np.random.Generator, error: np.ndarray, sd: float) -> tuple[TypeData, np.ndarray]:
    """Ten trucks, two campaigns each, that follow an error e ~ N(0, sd^2) by `error` (trucks,); and their values."""
    truck_of = np.repeat(np.arange(len(error)), 2)
    truck = 1.0 + 0.06 * random.standard_normal(len(error))
    moved = error[truck_of][:, None, None]
    y = truck[truck_of] + 0.03 * random.standard_normal(len(truck_of)) + moved[:, 0, 0] * sd * random.standard_normal()
    precision = np.full((len(truck_of), 1, 1), 0.03**-2.0)
    names = tuple(map(str, range(len(error)))), tuple(map(str, range(len(truck_of))))
    data = TypeData(
        ("c_1",), ("damping",), *names, truck_of, precision, precision[:, 0] * y[:, None], np.ones(1), moved,
        np.array([sd]),
    )  # fmt: skip
    return data, truck


def test_intervals_of_trucks_by_themselves_hold_the_truth_in_spite_of_a_shared_error() -> None:
    held = []
    for seed in range(400):
        data, truck = fleet_of_one_number(np.random.default_rng(seed), np.ones(10), 0.05)
        found = stand_alone(data, HyperPriors())
        held.append(np.mean(np.abs(found.value[:, 0] - truck) < norm.ppf(0.95) * found.sd[:, 0]))
    # The error is one draw per fleet: the share's own standard deviation is below 0.0145.
    assert np.mean(held) == pytest.approx(0.90, abs=0.03)


def test_a_shared_error_of_all_trucks_names_none_and_hides_none() -> None:
    data, _ = fleet_of_one_number(np.random.default_rng(1), np.ones(10), 0.05)
    shift = data.shift.copy()
    shift[:2] += data.precision[:2, 0] * np.log(0.5)
    broken = TypeData(*(shift if f == "shift" else getattr(data, f) for f in data.__dataclass_fields__))
    without = TypeData(
        *(getattr(broken, f) for f in list(data.__dataclass_fields__)[:-2]), np.zeros((20, 1, 0)), np.zeros(0)
    )
    priors = HyperPriors()
    (found,) = find_outliers(broken, stand_alone(broken, priors), priors)
    (expected,) = find_outliers(without, stand_alone(without, priors), priors)
    assert (found.truck, found.parameter) == (expected.truck, expected.parameter) == ("0", "c_1")
    assert found.factor == pytest.approx(expected.factor, rel=1e-3)
    assert found.probability == pytest.approx(expected.probability, rel=0.02)


def test_an_error_that_one_truck_alone_has_does_not_make_it_stand_out() -> None:
    """A truck that was weighed by other scales: named in as few fleets as any other."""
    priors, named = HyperPriors(), 0
    for seed in range(100):
        data, _ = fleet_of_one_number(np.random.default_rng(seed), np.eye(10)[0], 0.3)
        named += any(o.truck == "0" for o in find_outliers(data, stand_alone(data, priors), priors))
    assert named <= 3


def test_intervals_of_trucks_by_themselves_hold_the_scatter_of_repeats() -> None:
    data, _, _ = small_fleet(shared=False)
    fitted = fit_population("t", data, ("1",) * 3, [None] * 9, sampling=SHORT)
    added = (np.log(fitted.alone.q95 / fitted.alone.q05) / (2.0 * norm.ppf(0.95))) ** 2
    added -= stand_alone(data, HyperPriors()).sd ** 2
    # All of it for a truck with one campaign (their own priors are 3 wide), less for the others.
    assert np.all(added[1] > fitted.scatter.q50**2)
    assert np.all(added[1] < fitted.scatter.q95**2)
    others = np.delete(added, 1, axis=0)
    assert np.all(others > 0.0)
    assert np.all(others.mean(axis=0) < added[1])


def test_the_mode_is_found_where_logarithms_are_large_and_well_known() -> None:
    """Sums over the campaigns are 3e14 about zero, where differences of a search would be rounding."""
    random, trucks, sd = np.random.default_rng(8), 400, 1e-5
    x = 13.0 + 0.05 * random.standard_normal((trucks, 1)) + sd * random.standard_normal((trucks, 1))
    names = tuple(f"T{t}" for t in range(trucks))
    precision = np.full((trucks, 1, 1), sd**-2.0)
    data = TypeData(("k_1",), ("stiffness",), names, names, np.arange(trucks), precision, x / sd**2, np.array([12.9]))
    model = Hierarchy(data, HyperPriors())
    mode, covariance = laplace(model)
    # Of readings far better known than they differ, the spread's likelihood is that of a normal sample.
    assert np.exp(mode[0]) == pytest.approx(x.std(), rel=3e-3)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(1.0 / np.sqrt(2.0 * trucks), rel=0.02)
