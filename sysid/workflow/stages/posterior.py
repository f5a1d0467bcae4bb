"""Stages that sample: the posterior by ensembles, and the bands of the driven runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.display import NOT_DETERMINED, TextTable, shown_unit
from sysid.errors import NotConvergedError
from sysid.files import remove
from sysid.workflow.stage import Blocks, Command, Context, Whole
from sysid.workflow.stages.data import SCAN
from sysid.workflow.stages.fit import FIT, fit_state

if TYPE_CHECKING:
    import numpy as np

    from sysid.estimation.residuals.run_history import HistoryBand
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.results.contents import Results
    from sysid.workflow.settings import Settings

CHAIN = "chain"


# ---------------------------------------------------------------------- sample


def _sample(context: Context) -> Posterior:
    import numpy as np

    from sysid.posterior.log_density import LIKELIHOOD, LogDensity
    from sysid.posterior.sampled_posterior import optimum_warnings
    from sysid.posterior.sampling import sample_posterior

    fit, state = context[FIT].fit, fit_state(context)
    density, point = LogDensity(state).with_larger_steps(), state.point
    posterior = sample_posterior(
        density,
        fit.names,
        point.mode,
        point.covariance,
        LIKELIHOOD,
        context.settings.sampling,
        folder=context.folder / CHAIN,
        fingerprint=_chain_inputs(context),
        resume=context.resume,
        progress=context.progress,
        notice=context.notice,
    )
    of_optimum = optimum_warnings(
        posterior, np.exp(point.log_parameters), float(density(point.log_parameters[None])[0])
    )
    return replace(posterior, warnings=(*posterior.warnings, *of_optimum))


def _chain_inputs(context: Context) -> dict[str, str]:
    """What the draws depend on besides the settings: files, engine, versions and code."""
    from sysid.vehicle_model.engine import engine_name
    from sysid.workflow.sources import code_digest

    files = {f"file {name}": digest for name, digest in context.inputs.sha256.items()}
    used = {f"version of {name}": context.version[name] for name in ("sysid", "numpy", "jaxlib", "emcee")}
    return {**files, **used, "engine": engine_name(), "program code": code_digest(SAMPLE.code)}


def _sampled_so_far(context: Context) -> Posterior | None:
    """Draws of a chain that another process is still adding to, or that was stopped."""
    from sysid.posterior.log_density import LIKELIHOOD
    from sysid.posterior.sampling import chain_identity, posterior_so_far

    kept, options = context[FIT], context.settings.sampling
    point = kept.point
    identity = chain_identity(options, point.mode, point.covariance, _chain_inputs(context))
    return posterior_so_far(context.folder / CHAIN, identity, kept.fit.names, LIKELIHOOD, options)


def _without_chain(output: Path) -> None:
    """Remove a chain; the last segment goes first, so that a kill in between leaves a shorter one."""
    if (output / CHAIN).is_dir():
        from sysid.posterior.segments import segment_files

        for path in reversed(segment_files(output / CHAIN)):
            remove(path)


def _can_go_on(posterior: Posterior, settings: Settings) -> bool:
    steps = posterior.burn_in + posterior.thin * posterior.draws.shape[1]
    return not posterior.converged and steps < settings.sampling.max_steps


def _sample_warnings(posterior: Posterior, quick: bool) -> Sequence[str]:
    said = () if posterior.converged or quick else (posterior.message,)
    return (*said, *posterior.warnings)


def show_sample(posterior: Posterior, results: Results) -> Blocks:
    """Posterior medians with 90 % credible intervals; those that repeat the prior are named as such."""
    columns = ("parameter", "median", "90 % credible interval", "unit", "effective draws", "R-hat")
    table = TextTable("Posterior", columns)
    parameters = {} if results.fit is None else {p.name: p for p in results.fit.parameters}
    for s in posterior.summaries:
        factor, shown = shown_unit(parameters[s.name].unit)
        table.add_row(
            s.name,
            f"{s.q50 * factor:.4g}" if parameters[s.name].identified else NOT_DETERMINED,
            f"{s.q05 * factor:.4g} to {s.q95 * factor:.4g}",
            shown,
            f"{s.ess:.0f}",
            f"{s.rhat:.3f}",
        )
    yield table
    yield posterior.message


SAMPLE = Whole(
    name="sample",
    compute=_sample,
    needs=(SCAN, FIT),
    # The limit of steps determines when a chain ends, not its draws.
    settings=tuple(
        f"sampling.{name}"
        for name in (
            "ensembles",
            "walkers_per_parameter",
            "segment_steps",
            "adapting_steps",
            "start_inflation",
            "importance_draws",
            "importance_suffices",
            "min_steps",
            "min_effective",
            "rhat_limit",
            "seed",
            "preview",
        )
    ),
    code=("posterior",),
    unfinished=_can_go_on,
    so_far=_sampled_so_far,
    discard=_without_chain,
    put=lambda results, posterior: replace(results, posterior=posterior),
    warnings=_sample_warnings,
    in_run="always",
    effort=110.0,
    command=Command(
        help="Posterior of all parameters, until it has converged. By emcee.",
        show=show_sample,
        next=("predict",),
        fault=lambda posterior: None if posterior.converged else NotConvergedError,
    ),
)


def log_draws(posterior: Posterior) -> np.ndarray:
    """Draws (n, p) of the log parameters, one after the other."""
    import numpy as np

    return np.asarray(np.log(posterior.draws.reshape(-1, len(posterior.names))))


# ---------------------------------------------------------------------- bands


def _bands(context: Context) -> tuple[HistoryBand, ...]:
    from sysid.prediction.run_bands import run_bands

    draws = log_draws(context[SAMPLE])
    return run_bands(fit_state(context), draws, seed=context.settings.seed, progress=context.progress)


def _with_bands(results: Results, bands: tuple[HistoryBand, ...]) -> Results:
    from sysid.prediction.run_bands import with_bands

    if results.fit is None:
        return results
    return replace(results, fit=replace(results.fit, histories=with_bands(results.fit.histories, bands)))


BANDS = Whole(
    name="bands",
    compute=_bands,
    needs=(SCAN, FIT, SAMPLE),
    along_with=SAMPLE,
    settings=("sampling.seed",),
    code=("prediction",),
    put=_with_bands,
    in_run="always",
    effort=8.0,
)
