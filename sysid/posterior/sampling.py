"""The sampling stage: independent emcee ensembles, continued until they have converged or a stated limit."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import emcee
import numpy as np

from sysid.errors import DataRejectedError
from sysid.posterior.checkpoint import Checkpoint, Segment
from sysid.posterior.diagnostics import Diagnosis, diagnose, summarise
from sysid.posterior.moves import posterior_moves
from sysid.posterior.results import Posterior

Progress = Callable[[str, float], None]
Density = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SamplingOptions:
    """Settings of the sampling stage.

    `ensembles` independent ensembles of `walkers_per_parameter` walkers per parameter; sampling goes on in stretches of
    `segment_steps` until R-hat < `rhat_limit` and at least `min_effective` effective draws for every parameter, or
    `max_steps`.  `start_inflation` widens the Laplace covariance from which the walkers start.
    """

    ensembles: int = 4
    walkers_per_parameter: float = 2.1
    segment_steps: int = 20
    min_steps: int = 60
    max_steps: int = 1500
    rhat_limit: float = 1.01
    min_effective: float = 400.0
    start_inflation: float = 2.0
    seed: int = 0
    preview: bool = False


def sample_posterior(
    density: Density,
    names: tuple[str, ...],
    centre: np.ndarray,
    covariance: np.ndarray,
    likelihood: str,
    options: SamplingOptions | None = None,
    *,
    folder: Path | None = None,
    fingerprint: dict[str, str] | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Posterior:
    """Sample a posterior known near its Laplace approximation.

    Parameters
    ----------
    density : vectorised log-density, (n, p) -> (n,), of log parameters.
    names : (p,) names; draws are returned in natural units.
    centre, covariance : Laplace approximation (p,), (p, p) in log space.
    folder, fingerprint, resume : where segments are kept, what ties them to data and settings, and whether to go on.

    Raises
    ------
    DataRejectedError
        If no start point with a finite density is found, naming the parameter that leaves its domain.
    """
    options = options or SamplingOptions()
    report = progress or (lambda message, fraction: None)
    count = len(names)
    walkers = 2 * int(np.ceil(max(options.walkers_per_parameter * count, 2 * count + 2) / 2))
    moves = posterior_moves(centre, covariance)
    identity = _identity(options, centre, covariance, fingerprint or {})
    checkpoint = None if folder is None else Checkpoint(folder, identity)
    segments = [] if checkpoint is None else checkpoint.open(resume=resume)
    seeds = np.random.SeedSequence(options.seed).spawn(options.ensembles)
    samplers = [
        emcee.EnsembleSampler(walkers, count, density, moves=moves, vectorize=True) for _ in range(options.ensembles)
    ]
    if segments:
        states = [_restore(segments[-1], e) for e in range(options.ensembles)]
    else:
        states = [_start(density, names, centre, covariance, walkers, options, seed) for seed in seeds]

    # A chain that had already converged when it is resumed must not grow.
    diagnosis = diagnose(np.concatenate([s.draws for s in segments], axis=1)) if segments else None
    done = sum(s.draws.shape[1] for s in segments)
    while not _finished(diagnosis, done, options):
        report(_words(diagnosis, done), _fraction(diagnosis, done, options))
        # Two ensembles at a time: one compiled likelihood keeps one core busy.
        with ThreadPoolExecutor(max_workers=2) as pool:
            results = list(pool.map(_advance, samplers, states, [options.segment_steps] * len(samplers)))
        states = [state for state, _, _, _ in results]
        segment = Segment(
            np.stack([draws for _, draws, _, _ in results]),
            np.stack([logs for _, _, logs, _ in results]),
            np.stack([accepted for _, _, _, accepted in results]),
            np.stack([s.random_state[1] for s in states]),
            np.array([[s.random_state[2], s.random_state[3], s.random_state[4]] for s in states], float),
        )
        if checkpoint is not None:
            checkpoint.append(len(segments), segment)
        segments.append(segment)
        done += options.segment_steps
        diagnosis = diagnose(np.concatenate([s.draws for s in segments], axis=1))
    draws = np.concatenate([s.draws for s in segments], axis=1)
    logs = np.concatenate([s.log_probability for s in segments], axis=1)
    accepted = np.sum([s.accepted for s in segments], axis=0)
    diagnosis = diagnosis or diagnose(draws)
    return _posterior(names, draws, logs, accepted, diagnosis, likelihood, options)


def _identity(options: SamplingOptions, centre, covariance, fingerprint: dict[str, str]) -> dict[str, str]:
    settings = {k: str(v) for k, v in asdict(options).items() if k not in ("max_steps", "min_effective", "rhat_limit")}
    # The proposals depend on the covariance as well as on the optimum.
    content = np.concatenate([np.ravel(centre), np.ravel(covariance)]).astype(float)
    digest = hashlib.sha256(content.tobytes()).hexdigest()
    return {**fingerprint, **{f"setting {k}": v for k, v in settings.items()}, "least-squares optimum": digest}


def _start(density, names, centre, covariance, walkers, options, seed) -> emcee.State:
    """Walkers drawn from the inflated Laplace covariance, redrawn where the density is not finite."""
    generator = np.random.default_rng(seed)
    factor = np.linalg.cholesky(covariance) * np.sqrt(options.start_inflation)
    points = np.empty((0, centre.size))
    for _ in range(20):
        trial = centre + generator.standard_normal((walkers, centre.size)) @ factor.T
        points = np.concatenate([points, trial[np.isfinite(density(trial))]])
        if points.shape[0] >= walkers:
            break
    else:
        widest = names[int(np.argmax(np.diag(covariance)))]
        raise DataRejectedError(
            f"The posterior has no finite density around the least-squares optimum; parameter {widest} is the least "
            "certain one: give it a prior in campaign.toml or leave out runs that the fit does not explain."
        )
    points = points[:walkers]
    random = np.random.RandomState(np.random.MT19937(seed.spawn(1)[0]))
    return emcee.State(points, log_prob=density(points), random_state=random.get_state())


def _restore(segment: Segment, ensemble: int) -> emcee.State:
    position, has_gauss, cached = segment.random_positions[ensemble]
    random = ("MT19937", segment.random_keys[ensemble], int(position), int(has_gauss), float(cached))
    return emcee.State(segment.draws[ensemble, -1], log_prob=segment.log_probability[ensemble, -1], random_state=random)


def _advance(sampler: emcee.EnsembleSampler, state: emcee.State, steps: int):
    sampler.reset()
    last = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
    draws, logs = sampler.get_chain().copy(), sampler.get_log_prob().copy()
    end = emcee.State(last.coords, log_prob=last.log_prob, random_state=last.random_state)
    return end, draws, logs, sampler.backend.accepted.copy()


def _converged(diagnosis: Diagnosis, options: SamplingOptions) -> bool:
    return bool(diagnosis.rhat.max() < options.rhat_limit and diagnosis.ess.min() >= options.min_effective)


def _finished(diagnosis: Diagnosis | None, done: int, options: SamplingOptions) -> bool:
    if done >= options.max_steps:
        return True
    return diagnosis is not None and done >= options.min_steps and _converged(diagnosis, options)


def _words(diagnosis: Diagnosis | None, done: int) -> str:
    if diagnosis is None:
        return f"sampling, step {done}"
    return f"sampling, step {done}, R-hat {diagnosis.rhat.max():.3f}, effective draws {diagnosis.ess.min():.0f}"


def _fraction(diagnosis: Diagnosis | None, done: int, options: SamplingOptions) -> float:
    """Share of the work that is done: R-hat - 1 and the missing draws both fall about as 1 / steps."""
    if diagnosis is None or done == 0:
        return done / max(options.max_steps, 1)
    excess = max((diagnosis.rhat.max() - 1.0) / (options.rhat_limit - 1.0), options.min_effective / diagnosis.ess.min())
    needed = float(np.clip(done * excess, options.min_steps, options.max_steps))
    return min(done / max(needed, 1.0), 0.99)


def _posterior(names, draws, logs, accepted, diagnosis, likelihood, options) -> Posterior:
    kept = np.exp(draws[:, diagnosis.burn_in :])
    converged = _converged(diagnosis, options) and not options.preview
    worst = int(np.argmax(diagnosis.rhat))
    figures = (
        f"{draws.shape[0]} ensembles of {draws.shape[2]} walkers, {draws.shape[1]} steps: R-hat at most "
        f"{diagnosis.rhat[worst]:.3f} ({names[worst]}), at least {diagnosis.ess.min():.0f} effective draws"
    )
    if options.preview:
        message = f"Preview with a short chain, not for use. {figures}."
    elif converged:
        message = f"Converged. {figures}."
    else:
        message = f"Not converged at the limit of {options.max_steps} steps. {figures}; go on with a larger limit."
    return Posterior(
        names=names,
        draws=kept,
        log_probability=logs[:, diagnosis.burn_in :],
        burn_in=diagnosis.burn_in,
        thin=1,
        autocorrelation_time=diagnosis.autocorrelation_time,
        acceptance=accepted.mean(axis=1) / draws.shape[1],
        summaries=summarise(names, kept.reshape(-1, len(names)), diagnosis),
        converged=converged,
        preview=options.preview,
        likelihood=likelihood,
        message=message,
        seed=options.seed,
    )
