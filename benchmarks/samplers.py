"""Samplers side by side on the log-density of a finished fit: effective draws per likelihood and per second.

``python -m benchmarks.samplers --fit FOLDER [--campaign data/campaign.toml] [--seconds 300] [--only NAME ...]``

FOLDER is the output folder of `calibrate.py fit` or `run` with that campaign; a fit that is not there is computed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import emcee
import numpy as np

from benchmarks.machine import describe
from benchmarks.sampler_table import write_table
from benchmarks.work import ROOT

#: Effective draws and R-hat from which on a posterior is called converged, as in the product.
ENOUGH, RHAT = 400.0, 1.01
ENSEMBLES, WALKERS_PER_PARAMETER = 4, 2.1
#: Steps between two looks at the clock.
STRETCH = 20


@dataclass(frozen=True)
class Target:
    """What is sampled: a log-density (n, p) -> (n,), and its Laplace approximation.

    `sd` (p,) are the standard deviations of a converged posterior where there is one.
    """

    density: Any
    names: tuple[str, ...]
    centre: np.ndarray
    covariance: np.ndarray
    sd: np.ndarray | None = None


class Counted:
    """A log-density that counts its parameter sets."""

    def __init__(self, density: Any):
        self._density = density
        self.likelihoods = 0

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Log-densities (n,) of points (n, p)."""
        self.likelihoods += len(points)
        return np.asarray(self._density(points))


@dataclass(frozen=True)
class Draws:
    """What a sampler has found without its burn-in, (p,) each, and which share of its work went into that."""

    effective: np.ndarray
    rhat: np.ndarray
    sd: np.ndarray
    share_kept: float
    remark: str


@dataclass(frozen=True)
class Outcome:
    """One row of the table."""

    name: str
    effective: float
    rhat: float
    sd_ratio: tuple[float, float] | None
    likelihoods: int
    share_kept: float
    wall_s: float
    processor_s: float
    remark: str


def ours(target: Target, density: Counted, limit_s: float, seed: int) -> Draws:
    """The product's sampling stage."""
    from sysid.posterior.options import SamplingOptions
    from sysid.posterior.sampling import sample_posterior

    options = SamplingOptions(seed=seed)
    # The stage has no limit of time: an ensemble's steps are of known cost.
    one = _seconds(lambda: density(np.tile(target.centre, (64, 1)))) / 64
    walkers = ENSEMBLES * WALKERS_PER_PARAMETER * len(target.names)
    most = max(2 * options.min_steps, int(limit_s / (walkers * one)))
    options = SamplingOptions(seed=seed, max_steps=most)
    posterior = sample_posterior(density, target.names, target.centre, target.covariance, "", options)
    steps = posterior.draws.shape[1] + posterior.burn_in
    return Draws(
        np.array([s.ess for s in posterior.summaries]),
        np.array([s.rhat for s in posterior.summaries]),
        np.log(posterior.draws).std(axis=(0, 1, 2)),
        posterior.draws.shape[1] / steps,
        f"{ENSEMBLES} ensembles of {posterior.draws.shape[2]} walkers, {steps} steps",
    )


def emcee_moves(moves: Callable[[], list[tuple[emcee.moves.Move, float]]]) -> Sampler:
    """A sampler by other moves of emcee: the same ensembles, the same starts, the same judgement."""

    def sample(target: Target, density: Counted, limit_s: float, seed: int) -> Draws:
        from sysid.posterior.diagnostics import diagnose
        from sysid.posterior.ensembles import Ensemble, advance, first
        from sysid.posterior.history import History

        count = len(target.names)
        walkers = 2 * int(np.ceil(max(WALKERS_PER_PARAMETER * count, 2 * count + 2) / 2))
        spread = 2.0 * target.covariance
        seeds = np.random.SeedSequence(seed).spawn(ENSEMBLES)
        states = [first(density, target.names, target.centre, spread, walkers, s) for s in seeds]
        ensembles = [Ensemble(moves(), state) for state in states]
        history, begin = History(), time.process_time()
        while time.process_time() - begin < limit_s:
            history.append(advance(density, ensembles, STRETCH))
        found = diagnose(history.draws)
        kept = 1.0 - found.burn_in / history.steps
        remark = f"{ENSEMBLES} ensembles of {walkers} walkers, {history.steps} steps"
        sd = history.draws[:, found.burn_in :].std(axis=(0, 1, 2))
        return Draws(found.ess, found.rhat, sd, kept, remark)

    return sample


Sampler = Callable[[Target, Counted, float, int], Draws]

SAMPLERS: dict[str, Sampler] = {
    "ours": ours,
    "emcee, stretch move (its default)": emcee_moves(lambda: [(emcee.moves.StretchMove(), 1.0)]),
    "emcee, DE and DE snooker (4 to 1)": emcee_moves(
        lambda: [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    ),
}


def _seconds(call: Callable[[], object], repeats: int = 5) -> float:
    """Processor time of a call, the median of some."""
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        found.append(time.process_time() - begin)
    return float(np.median(found))


def finished_fit(campaign: Path, folder: Path) -> Target:
    """The log-density that the sampling stage would get from the fit in an output folder."""
    from sysid.posterior.log_density import LogDensity
    from sysid.workflow import Calibration
    from sysid.workflow.stages.fit import fit_state
    from sysid.workflow.stages.posterior import SAMPLE

    calibration = Calibration(campaign, folder, resume=True)
    fit = calibration.fit()
    state = fit_state(calibration._runner.context(SAMPLE))
    density = LogDensity(state).with_larger_steps()
    sampled, point = calibration._runner.known(SAMPLE), state.point
    sd = None
    if sampled is not None and sampled.converged:
        sd = np.log(sampled.draws).std(axis=(0, 1, 2))
    return Target(density, fit.names, np.asarray(point.mode, float), np.asarray(point.covariance), sd)


def measure(target: Target, name: str, limit_s: float, seed: int) -> Outcome:
    """Run one sampler."""
    density = Counted(target.density)
    density(np.tile(target.centre, (2, 1)))
    density.likelihoods = 0
    wall, processor = time.perf_counter(), time.process_time()
    found = SAMPLERS[name](target, density, limit_s, seed)
    ratio = None if target.sd is None else found.sd / target.sd
    return Outcome(
        name,
        float(found.effective.min()),
        float(found.rhat.max()),
        None if ratio is None else (float(ratio.min()), float(ratio.max())),
        density.likelihoods,
        found.share_kept,
        time.perf_counter() - wall,
        time.process_time() - processor,
        found.remark,
    )


def cost(target: Target) -> float:
    """Processor seconds of a likelihood in a batch as the sampler has it."""
    half = int(np.ceil(WALKERS_PER_PARAMETER * len(target.names) / 2))
    factor = np.linalg.cholesky(target.covariance)
    sets = target.centre + np.random.default_rng(5).standard_normal((half, len(target.names))) @ factor.T
    target.density(sets)
    return _seconds(lambda: target.density(sets), 15) / half


def main() -> None:
    """Run the samplers in turn, write ``samplers.json`` after each, and on request the table of the documentation."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.samplers", description=__doc__)
    parser.add_argument("--fit", type=Path, required=True, help="output folder with the fit")
    parser.add_argument("--campaign", type=Path, default=ROOT / "data" / "campaign.toml")
    parser.add_argument("--output", type=Path, default=Path("build/benchmarks"))
    parser.add_argument("--seconds", type=float, default=300.0, help="processor time of one sampler")
    parser.add_argument("--only", nargs="+", choices=tuple(SAMPLERS), default=tuple(SAMPLERS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--document", type=Path, help="page to write the table to")
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "samplers.json"
    target = finished_fit(options.campaign, options.fit)
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    rows: dict[str, Any] = kept.get("samplers", {})
    for name in options.only:
        rows[name] = asdict(measure(target, name, options.seconds, options.seed))
        sys.stderr.write(f"{rows[name]}\n")
        found = {
            "machine": describe(),
            "campaign": options.campaign.parent.name,
            "parameters": len(target.names),
            "likelihood_s": cost(target),
            "samplers": rows,
        }
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.document is not None:
        write_table(json.loads(path.read_text(encoding="utf-8")), options.document)


if __name__ == "__main__":
    main()
