"""The sampling stage: independent emcee ensembles, continued until they have converged or a stated limit."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path

import emcee
import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.posterior.checkpoint import Checkpoint, Resumed, read_chain
from sysid.posterior.diagnostics import Diagnosis, diagnose, standstills, summarise
from sysid.posterior.ensembles import Density, Ensemble, advance, first, restored
from sysid.posterior.history import History
from sysid.posterior.importance import ImportanceSample, importance_sample
from sysid.posterior.moves import fitted_to_walkers, posterior_moves
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampled_posterior import Posterior
from sysid.progress import Progress, unwatched
from sysid.threads import one_blas_thread

Notice = Callable[[str], None]

#: Convergence is judged after every segment up to twice as many, then after every second one, after twice as many again
#: after every fourth, and so on: judging takes a time that grows with the chain.
_DENSE_SEGMENTS = 50
#: Share of proposals without a finite density above which the user is warned.
_MANY_REJECTED = 0.01
#: Every how many steps proposals that are fitted to draws look at the walkers.
_APART = 5


@one_blas_thread()
def sample_posterior(
    density: Density,
    names: tuple[str, ...],
    centre: Parameters,
    covariance: ParametersByParameters,
    likelihood: str,
    options: SamplingOptions | None = None,
    *,
    folder: Path | None = None,
    fingerprint: dict[str, str] | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    notice: Notice | None = None,
) -> Posterior:
    """Sample a posterior known near its Laplace approximation.

    Parameters
    ----------
    density : vectorised log-density, (n, p) -> (n,), of log parameters; values that are not finite count as zero
        density and are counted.
    names : (p,) names; draws are returned in natural units.
    centre, covariance : Laplace approximation (p,), (p, p) in log space.
    folder, fingerprint, resume : where the chain is kept, what ties it to data and settings, and whether to go on.
    progress, notice : callbacks for progress (message, fraction), and for what the user should know about a checkpoint.

    Raises
    ------
    DataRejectedError
        If no start point with a finite density is found, naming the parameter that leaves its domain.
    CampaignError
        If the chain to go on with belongs to other data or settings.
    OutputError
        If the folder cannot be written or another process writes to it.
    """
    options = options or SamplingOptions()
    report = progress or unwatched
    report("importance sampling", 0.0)
    importance = importance_sample(
        density, centre, covariance, options.seed, options.importance_draws, sided=options.importance_suffices
    )
    near = importance.is_reliable
    suffices = options.importance_suffices and importance.effective >= options.min_effective
    if near and (options.preview or suffices):
        return _without_chain(names, importance, likelihood, options)
    identity = chain_identity(options, centre, covariance, fingerprint or {})
    with nullcontext() if folder is None else Checkpoint(folder, identity) as checkpoint:
        resumed = Resumed([], None, "") if checkpoint is None else checkpoint.open(resume=resume)
        if resumed.note and notice is not None:
            notice(resumed.note)
        history = History(resumed.segments)
        states = _states(density, names, centre, covariance, options, resumed)
        proposals = _proposals(history, centre, covariance, options)

        def moves() -> list[tuple[emcee.moves.Move, float]]:
            """Moves of its own for every ensemble: emcee's keep a step size while they propose."""
            return posterior_moves(*proposals, options.seed, history.steps)

        ensembles = [Ensemble(moves(), state) for state in states]
        # A chain that had already converged when it is resumed must not grow.
        judged_at = history.steps if _due(history.steps, options) else 0
        diagnosis = _judged(history, options, near=near) if judged_at else None

        def say(share: float) -> None:
            """Report the steps so far and a share of the next stretch."""
            later = share * options.segment_steps
            report(_words(diagnosis, history.steps), _fraction(diagnosis, history.steps, options, later))

        while not _finished(diagnosis, history.steps, options):
            say(0.0)
            segment = advance(density, ensembles, options.segment_steps, say)
            if checkpoint is not None:
                checkpoint.append(segment)
            history.append(segment)
            if _due(history.steps, options):
                diagnosis, judged_at = _judged(history, options, near=near), history.steps
            if history.steps == _adapted(history.steps, options):
                proposals = _proposals(history, centre, covariance, options)
                ensembles = [ensemble.with_moves(moves()) for ensemble in ensembles]
        if diagnosis is None or judged_at < history.steps:
            # The limit lies where convergence is not judged.
            diagnosis = _judged(history, options, near=near)
    sampled = _posterior(names, history, diagnosis, likelihood, options)
    return replace(sampled, message=f"{sampled.message} {importance.sentence(chain=True)}")


def _without_chain(
    names: tuple[str, ...], importance: ImportanceSample, likelihood: str, options: SamplingOptions
) -> Posterior:
    """The posterior from importance sampling alone, its draws in as many groups as there would be ensembles."""
    logs, log_probability = importance.resampled(options.ensembles, np.random.default_rng(options.seed))
    count, effective = len(names), importance.effective
    preview = "Preview without a chain, not for use. " if options.preview else ""
    diagnosis = Diagnosis(0, np.ones(count), np.full(count, effective), diagnose(logs).rhat)
    draws = np.exp(logs)
    return Posterior(
        names=names,
        draws=draws,
        log_probability=log_probability,
        burn_in=0,
        thin=1,
        autocorrelation_time=diagnosis.autocorrelation_time,
        acceptance=np.full(options.ensembles, effective / len(importance.draws)),
        summaries=summarise(names, draws.reshape(-1, count), diagnosis),
        converged=not options.preview,
        preview=options.preview,
        likelihood=likelihood,
        message=f"{preview}{importance.sentence(chain=False)}",
        seed=options.seed,
    )


def posterior_so_far(
    folder: Path,
    identity: dict[str, str],
    names: tuple[str, ...],
    likelihood: str,
    options: SamplingOptions,
) -> Posterior | None:
    """Draws of a chain that is still being written, or was stopped; None if there is none of these data and settings.

    It is never called converged: the sampling stage alone decides that.
    """
    stored = read_chain(folder)
    if stored is None or stored[0] != identity:
        return None
    history = History(stored[1])
    return _posterior(names, history, _judged(history, options), likelihood, options, finished=False)


def chain_identity(
    options: SamplingOptions, centre: Parameters, covariance: ParametersByParameters, fingerprint: dict[str, str]
) -> dict[str, str]:
    """What a chain depends on, by name: files, settings, and the Laplace approximation."""
    settings = {k: str(v) for k, v in asdict(options).items() if k not in ("max_steps", "min_effective", "rhat_limit")}
    # The proposals depend on the covariance as well as on the optimum.
    content = np.concatenate([np.ravel(centre), np.ravel(covariance)]).astype(float)
    digest = hashlib.sha256(content.tobytes()).hexdigest()
    return {**fingerprint, **{f"setting {k}": v for k, v in settings.items()}, "least-squares optimum": digest}


def _states(
    density: Density,
    names: tuple[str, ...],
    centre: Parameters,
    covariance: ParametersByParameters,
    options: SamplingOptions,
    resumed: Resumed,
) -> list[emcee.State]:
    """Positions of the walkers of every ensemble when the chain begins or continues."""
    if resumed.ending is not None:
        return [restored(resumed.ending, e) for e in range(options.ensembles)]
    count = len(names)
    walkers = 2 * int(np.ceil(max(options.walkers_per_parameter * count, 2 * count + 2) / 2))
    wider = covariance * options.start_inflation
    seeds = np.random.SeedSequence(options.seed).spawn(options.ensembles)
    return [first(density, names, centre, wider, walkers, seed) for seed in seeds]


def _proposals(
    history: History, centre: Parameters, covariance: ParametersByParameters, options: SamplingOptions
) -> tuple[Parameters, ParametersByParameters]:
    """Centre and covariance of the independence proposals after the steps so far.

    They depend on these steps alone, not on where a run was interrupted.
    """
    last = _adapted(history.steps, options)
    if last == 0:
        return centre, covariance
    return fitted_to_walkers(covariance, history.draws[:, last // 2 : last : _APART])


def _adapted(steps: int, options: SamplingOptions) -> int:
    """The step at which proposals were last fitted to draws, of a chain of so many steps; 0 before."""
    last, again, stretch = 0, options.adapting_steps, options.segment_steps
    # At the end of a stretch: only there the moves can change.
    while 0 < -(-again // stretch) * stretch <= steps:
        last, again = -(-again // stretch) * stretch, 2 * again
    return last


def _judged(history: History, options: SamplingOptions, *, near: bool = False) -> Diagnosis:
    # Proposals that are fitted at the last of the steps have made none of them.
    return diagnose(history.draws, _adapted(history.steps - 1, options), history.log_probability, near=near)


def _due(done: int, options: SamplingOptions) -> bool:
    """Whether convergence is judged after so many steps: it must not depend on where a run was interrupted.

    A chain that could not be called converged yet is not judged: that takes a tenth of the time of its steps.
    """
    if not _kept_enough(done, options):
        return False
    segments = done // options.segment_steps
    stride = 1
    while segments >= 2 * stride * _DENSE_SEGMENTS:
        stride *= 2
    return segments > 0 and segments % stride == 0


def _converged(diagnosis: Diagnosis, options: SamplingOptions) -> bool:
    return bool(diagnosis.worst_rhat < options.rhat_limit and diagnosis.ess.min() >= options.min_effective)


def _finished(diagnosis: Diagnosis | None, done: int, options: SamplingOptions) -> bool:
    if done >= options.max_steps:
        return True
    return diagnosis is not None and _kept_enough(done, options) and _converged(diagnosis, options)


def _kept_enough(done: int, options: SamplingOptions) -> bool:
    """Whether there are enough steps behind the one at which proposals were last fitted to draws."""
    adapted = _adapted(done - 1, options)
    return done >= max(adapted + options.min_steps, -(-5 * adapted // 4))


def _words(diagnosis: Diagnosis | None, done: int) -> str:
    if diagnosis is None:
        return f"sampling, step {done}"
    return f"sampling, step {done}, R-hat {diagnosis.worst_rhat:.3f}, effective draws {diagnosis.ess.min():.0f}"


def _fraction(diagnosis: Diagnosis | None, done: int, options: SamplingOptions, later: float) -> float:
    """Share of the work that is done `later` steps on: R-hat - 1 and the missing draws both fall about as 1 / steps."""
    if diagnosis is None or done == 0:
        return min((done + later) / max(min(2 * options.min_steps, options.max_steps), 1), 0.99)
    excess = max((diagnosis.worst_rhat - 1.0) / (options.rhat_limit - 1.0), options.min_effective / diagnosis.ess.min())
    needed = float(np.clip(done * excess, options.min_steps, options.max_steps))
    return min((done + later) / max(needed, 1.0), 0.99)


def _posterior(
    names: tuple[str, ...],
    history: History,
    diagnosis: Diagnosis,
    likelihood: str,
    options: SamplingOptions,
    *,
    finished: bool = True,
) -> Posterior:
    draws, steps = history.draws, history.steps
    kept = np.exp(draws[:, diagnosis.burn_in :])
    converged = finished and _kept_enough(steps, options) and _converged(diagnosis, options) and not options.preview
    # The log-density comes behind the parameters.
    worst = int(np.argmax([*diagnosis.rhat, diagnosis.density_rhat]))
    proposals, rejected = history.accepted.size * steps, int(history.rejected.sum())
    figures = (
        f"{draws.shape[0]} ensembles of {draws.shape[2]} walkers, {steps} steps: R-hat at most "
        f"{diagnosis.worst_rhat:.3f} ({(*names, 'log-density')[worst]}), "
        f"at least {diagnosis.ess.min():.0f} effective draws"
    )
    if rejected:
        figures += f", {rejected} of {proposals} proposals without a finite simulation"
    if not finished:
        message = f"Sampling has not finished. {figures} so far; go on with the stage 'sample' and --resume."
    elif options.preview:
        message = f"Preview with a short chain, not for use. {figures}."
    elif converged:
        message = f"Converged. {figures}."
    else:
        message = f"Not converged at the limit of {options.max_steps} steps. {figures}; go on with a larger limit."
    stuck = _stuck_walkers(history, diagnosis)
    return Posterior(
        names=names,
        draws=kept,
        log_probability=history.log_probability[:, diagnosis.burn_in :].copy(),
        burn_in=diagnosis.burn_in,
        thin=1,
        autocorrelation_time=diagnosis.autocorrelation_time,
        acceptance=history.accepted.mean(axis=1) / steps,
        summaries=summarise(names, kept.reshape(-1, len(names)), diagnosis),
        converged=converged,
        preview=options.preview,
        likelihood=likelihood,
        message=message,
        seed=options.seed,
        warnings=(*_rejections(rejected / proposals), *stuck),
        rejected=rejected,
        against_intervals=stuck,
    )


def _rejections(rejected_share: float) -> tuple[str, ...]:
    if rejected_share <= _MANY_REJECTED:
        return ()
    return (
        f"{100 * rejected_share:.0f} % of the parameter sets that the sampler proposed have no finite simulation: "
        "the posterior includes values with which the vehicle model fails; give priors to the parameters with the "
        "widest intervals.",
    )


def _stuck_walkers(history: History, diagnosis: Diagnosis) -> tuple[str, ...]:
    stuck = standstills(history.draws, diagnosis.burn_in)
    if not stuck.any():
        return ()
    ensemble, walker = np.unravel_index(int(stuck.argmax()), stuck.shape)
    return (
        f"{np.count_nonzero(stuck)} of {stuck.size} walkers are stuck: walker {walker + 1} of ensemble "
        f"{ensemble + 1} did not move for {stuck.max()} steps while the others did; the posterior may have a "
        "second mode there: do not trust its intervals before another --seed gives the same.",
    )
