"""Three campaigns and their population sampled all at once, beside the two stages: ``python -m studies.fleets.joint``.

Three simulated three-axle trucks with one campaign each are calibrated.  Then all parameters of all campaigns, the
type's mean, spreads and correlations are sampled together, by Metropolis within Gibbs, from the densities that the
campaigns themselves were sampled from: no campaign is replaced by its draws or by a Gaussian.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studies.documents import write_between_marks
from sysid.fleet.assembly import assemble
from sysid.fleet.draws import RECORD_FILE, CampaignDraws, read_draws
from sysid.fleet.hierarchy import HyperPriors
from sysid.fleet.members import members as members_of
from sysid.fleet.population import Quantiles, TypePopulation, fit_population
from sysid.fleet.population_prior import Fitted
from sysid.fleet.read import read_fleet
from sysid.fleet.resample import read_fitted
from sysid.fleet.running import RunOptions, campaign_output, run_fleet
from sysid.fleet.simulate import simulate_fleet
from sysid.progress import unwatched

RIGID = Path(__file__).resolve().parents[2] / "examples" / "vehicles" / "rigid3"
#: Degrees of freedom of the proposals of a campaign's parameters: heavier tails than their densities have.
_FREEDOM = 10.0
#: Steps of the spreads and correlations between two of the campaigns' parameters: they cost next to nothing.
_SPREAD_STEPS = 30
#: Width of a 90 % interval of a normal in its standard deviations.
_WIDTH = 2.0 * 1.6448536


@dataclass(frozen=True)
class Member:
    """One campaign: its density, places of the shared parameters, and their prior's mean and precision.

    `centre` (p,) and `precision` (p, p) of the draws of the density, which proposals begin with.
    """

    fitted: Fitted
    at: np.ndarray
    prior: tuple[np.ndarray, np.ndarray]
    centre: np.ndarray
    precision: np.ndarray


def member(fitted: Fitted, record: CampaignDraws, names: tuple[str, ...]) -> Member:
    """What the sampler needs of a campaign."""
    at = np.array([record.names.index(name) for name in names])
    prior = record.prior_mean[at], np.linalg.inv(record.prior_covariance[np.ix_(at, at)])
    return Member(fitted, at, prior, fitted.centre, np.linalg.inv(fitted.covariance))


def log_normal(x: np.ndarray, mean: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Log-density (n,) at x (n, d) of normals with precisions (n, d, d), up to the constant of 2 pi."""
    off = x - mean
    return np.asarray(0.5 * np.linalg.slogdet(precision)[1] - 0.5 * np.einsum("ni,nij,nj->n", off, precision, off))


class JointSampler:
    """`chains` chains of everything at once; `mean`, `spread` and `trucks` of every step after a fifth of them."""

    def __init__(
        self,
        members: list[Member],
        quantities: tuple[str, ...],
        centre: np.ndarray,
        priors: HyperPriors,
        chains: int,
        seed: int,
    ):
        self._members, self._priors, self._centre = members, priors, centre
        self._random = np.random.default_rng(seed)
        self._groups = [np.flatnonzero([q == name for q in quantities]) for name in dict.fromkeys(quantities)]
        d = len(quantities)
        self._log_spread = np.log(0.1) + 0.3 * self._random.standard_normal((chains, d))
        self._odds = self._random.standard_normal((chains, len(self._groups)))
        self._mean = np.tile(np.mean([m.fitted.centre[m.at] for m in members], axis=0), (chains, 1))
        self._x = [np.tile(m.fitted.centre, (chains, 1)) for m in members]
        self._density = [m.fitted.density(x) for m, x in zip(members, self._x, strict=True)]
        self.accepted = np.zeros(len(members))

    def covariance(self, log_spread: np.ndarray, odds: np.ndarray) -> np.ndarray:
        """T (n, d, d): spreads, and one correlation per quantity between -1/(m - 1) and 1."""
        n, d = log_spread.shape
        correlation = np.zeros((n, d, d))
        for position, at in enumerate(self._groups):
            if at.size > 1:
                lowest = -1.0 / (at.size - 1)
                rho = lowest + (1.0 - lowest) / (1.0 + np.exp(-odds[:, position]))
                correlation[:, at[:, None], at] = (1.0 - 1e-9) * rho[:, None, None]
            correlation[:, at, at] = 1.0
        spread = np.exp(log_spread)
        return spread[:, :, None] * correlation * spread[:, None, :]

    def run(self, steps: int) -> dict[str, np.ndarray]:
        """Draws (n, ...) of mean, spread and trucks, as logarithms."""
        kept: dict[str, list[np.ndarray]] = {"mean": [], "spread": [], "trucks": []}
        for step in range(steps):
            between = np.linalg.inv(self.covariance(self._log_spread, self._odds))
            for number in range(len(self._members)):
                self._move_campaign(number, between)
            trucks = np.stack([x[:, m.at] for x, m in zip(self._x, self._members, strict=True)], axis=1)
            self._move_spreads(trucks)
            self._draw_mean(trucks)
            if step >= steps // 5:
                for name, values in (("mean", self._mean), ("spread", self._log_spread), ("trucks", trucks)):
                    kept[name].append(values.copy())
            if step % 50 == 0:
                sys.stderr.write(f"step {step}: {self.accepted / (step + 1)} accepted\n")
        self.accepted /= steps
        return {name: np.concatenate(values) for name, values in kept.items()}

    def _move_campaign(self, number: int, between: np.ndarray) -> None:
        """Metropolis-Hastings of all parameters of a campaign, given the population."""
        m, x = self._members[number], self._x[number]
        chains, p = x.shape
        # The population in place of the prior: a quadratic form h'x - x'K x / 2.
        k, h = np.zeros((chains, p, p)), np.zeros((chains, p))
        k[:, m.at[:, None], m.at] = between - m.prior[1]
        h[:, m.at] = np.einsum("nij,nj->ni", between, self._mean) - m.prior[1] @ m.prior[0]

        def log_population(at: np.ndarray) -> np.ndarray:
            return np.asarray((h * at).sum(axis=1) - 0.5 * np.einsum("ni,nij,nj->n", at, k, at))

        precision = m.precision + k
        step = h - np.einsum("nij,j->ni", k, m.centre)
        mean = m.centre + np.linalg.solve(precision, step[..., None])[..., 0]
        root = np.linalg.inv(np.linalg.cholesky(precision)).transpose(0, 2, 1)
        scale = np.sqrt(_FREEDOM / self._random.chisquare(_FREEDOM, (chains, 1)))
        proposed = mean + scale * np.einsum("nij,nj->ni", root, self._random.standard_normal((chains, p)))

        def log_proposal(at: np.ndarray) -> np.ndarray:
            square = np.einsum("ni,nij,nj->n", at - mean, precision, at - mean)
            return np.asarray(-0.5 * (_FREEDOM + p) * np.log1p(square / _FREEDOM))

        density = m.fitted.density(proposed)
        ratio = density + log_population(proposed) - log_proposal(proposed)
        ratio -= self._density[number] + log_population(x) - log_proposal(x)
        better = np.log(self._random.uniform(size=chains)) < ratio
        self._x[number] = np.where(better[:, None], proposed, x)
        self._density[number] = np.where(better, density, self._density[number])
        self.accepted[number] += better.mean()

    def _move_spreads(self, trucks: np.ndarray) -> None:
        """Random-walk Metropolis of spreads and correlations, with the mean integrated out."""
        log = self._log_spread_density(trucks, self._log_spread, self._odds)
        for _ in range(_SPREAD_STEPS):
            size = np.exp(self._random.uniform(-3.0, 0.3, (len(log), 1)))
            spread = self._log_spread + size * self._random.standard_normal(self._log_spread.shape)
            odds = self._odds + 2.0 * size * self._random.standard_normal(self._odds.shape)
            proposed = self._log_spread_density(trucks, spread, odds)
            better = np.log(self._random.uniform(size=len(log))) < proposed - log
            self._log_spread = np.where(better[:, None], spread, self._log_spread)
            self._odds = np.where(better[:, None], odds, self._odds)
            log = np.where(better, proposed, log)

    def _log_spread_density(self, trucks: np.ndarray, log_spread: np.ndarray, odds: np.ndarray) -> np.ndarray:
        count = trucks.shape[1]
        covariance = self.covariance(log_spread, odds)
        middle = trucks.mean(axis=1)
        off = trucks - middle[:, None]
        precision = np.linalg.inv(covariance)
        log = -0.5 * np.einsum("nti,nij,ntj->n", off, precision, off)
        log -= 0.5 * (count - 1) * np.linalg.slogdet(covariance)[1]
        wide = covariance / count + self._priors.mean_sd**2 * np.eye(covariance.shape[1])
        log += log_normal(middle, self._centre, np.linalg.inv(wide))
        # Half-Cauchy spreads and uniform correlations, with the Jacobians of the logarithm and of the odds.
        log += (log_spread - np.log1p((np.exp(log_spread) / self._priors.spread_scale) ** 2)).sum(axis=1)
        log += (-odds - 2.0 * np.log1p(np.exp(-odds))).sum(axis=1)
        return np.where(np.isfinite(log), log, -np.inf)

    def _draw_mean(self, trucks: np.ndarray) -> None:
        between = np.linalg.inv(self.covariance(self._log_spread, self._odds))
        d = between.shape[1]
        precision = trucks.shape[1] * between + np.eye(d) * self._priors.mean_sd**-2.0
        linear = np.einsum("nij,nj->ni", between, trucks.sum(axis=1)) + self._centre * self._priors.mean_sd**-2.0
        root = np.linalg.inv(np.linalg.cholesky(precision)).transpose(0, 2, 1)
        noise = np.einsum("nij,nj->ni", root, self._random.standard_normal(linear.shape))
        self._mean = np.linalg.solve(precision, linear[..., None])[..., 0] + noise


@dataclass(frozen=True)
class Compared:
    """One quantity by both ways: how far apart the medians are [sd of the joint one], and the ratio of the widths."""

    what: str
    name: str
    apart: float
    ratio: float


def compared(two_stages: TypePopulation, joint: dict[str, np.ndarray]) -> list[Compared]:
    """Mean, spread and every truck by both ways, as logarithms."""
    rows = []
    for what, quantiles in (("mean", two_stages.mean), ("spread", two_stages.spread), ("trucks", two_stages.trucks)):
        low, middle, high = np.quantile(joint[what], [0.05, 0.5, 0.95], axis=0)
        found: Quantiles = quantiles
        sd = (high - low) / _WIDTH
        apart = (np.log(found.q50) - middle) / sd
        ratio = np.log(found.q95 / found.q05) / (high - low)
        for index in np.ndindex(apart.shape):
            name = two_stages.names[index[-1]]
            truck = f"{two_stages.truck_names[index[0]]}, " if len(index) == 2 else ""
            rows.append(Compared(what, truck + name, float(apart[index]), float(ratio[index])))
    return rows


def compare(folder: Path, *, chains: int = 96, steps: int = 1500, seed: int = 3) -> tuple[list[Compared], str]:
    """Simulate and calibrate three trucks, and sample them both ways; and how often steps of campaigns were taken."""
    fleet, output = folder / "fleet", folder / "out"
    if not fleet.exists():
        simulate_fleet(RIGID, fleet, trucks=3, campaigns=1, seed=seed)
    known = read_fleet(fleet)
    rows = run_fleet(known, output, RunOptions(choices={"laws": "declared"}), lambda rows: None)
    if any(row.state != "done" for row in rows):
        raise SystemExit(f"Not all campaigns are done: {[(row.campaign, row.state) for row in rows]}")
    priors = HyperPriors()
    assembled = assemble(members_of(known, output, rows[0].type), known.shared, priors)
    records = [read_draws(m.output / RECORD_FILE) for m in assembled.members]
    of_names = [r.of(assembled.data.names) for r in records if r is not None]
    two_stages = fit_population(rows[0].type, assembled.data, assembled.units, of_names, priors=priors)
    folders = {c.name: c.folder for _, c in known.campaigns()}
    members = [
        member(
            read_fitted(folders[m.campaign], campaign_output(output, m.campaign), unwatched), r, assembled.data.names
        )
        for m, r in zip(assembled.members, records, strict=True)
        if r is not None
    ]
    sampler = JointSampler(members, assembled.data.quantities, assembled.data.mean, priors, chains, seed)
    joint = sampler.run(steps)
    taken = ", ".join(f"{100.0 * share:.0f} %" for share in sampler.accepted)
    return compared(two_stages, joint), f"{taken}; Pareto k {', '.join(f'{k:.2f}' for k in two_stages.pareto_k)}"


def table(rows: list[Compared], words: str) -> str:
    """Markdown: the largest differences of every kind."""
    lines = ["| | quantities | medians apart, at most [sd] | ratio of the widths |", "|---|---|---|---|"]
    kinds = {"mean": "mean of the type", "spread": "spread between trucks", "trucks": "k and c of every truck"}
    for what, title in kinds.items():
        some = [row for row in rows if row.what == what]
        ratios = [row.ratio for row in some]
        apart = max(abs(row.apart) for row in some)
        lines.append(f"| {title} | {len(some)} | {apart:.2f} | {min(ratios):.2f} to {max(ratios):.2f} |")
    return "\n".join([*lines, "", f"Steps of the three campaigns that were taken: {words}."])


def main(arguments: list[str] | None = None) -> None:
    """Compare, and show the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/fleet_joint"), help="folder of the fleet")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    rows, words = compare(options.output.resolve(), steps=options.steps)
    for row in rows:
        sys.stdout.write(f"{row.what:8} {row.name:24} {row.apart:+.3f} {row.ratio:.3f}\n")
    text = table(rows, words)
    sys.stdout.write(text + "\n")
    if options.document is not None:
        write_between_marks(options.document, "joint", text)


if __name__ == "__main__":
    main()
