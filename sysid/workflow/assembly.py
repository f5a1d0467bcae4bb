"""Combines the results of all stages that have run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sysid.results.contents import Results, Status
from sysid.results.judgement import judge
from sysid.workflow.inputs import Inputs
from sysid.workflow.runner import Runner
from sysid.workflow.settings import Settings, date_of
from sysid.workflow.stage import Stage
from sysid.workflow.stages import STAGES
from sysid.workflow.versions import versions


def assembled(runner: Runner, inputs: Inputs, settings: Settings) -> Results:
    """Everything that has been computed so far for these inputs and settings."""
    results = Results(campaign=inputs.campaign)
    of_stages: list[str] = []
    for stage in STAGES:
        result = runner.known(stage)
        if result is None:
            result = runner.so_far(stage)
            if result is not None:
                results = replace(results, unfinished=(*results.unfinished, stage.name))
        if result is not None:
            results = _with(results, stage, result)
            of_stages += stage.warnings(result, settings.quick and stage.name not in results.unfinished)
    results = replace(
        results,
        status=_status(results, settings),
        warnings=(*inputs.read.messages, *_general_warnings(results, settings), *of_stages),
        provenance={
            "input_sha256": dict(inputs.sha256),
            # Building an engine takes time: its name is known where one has been used.
            "versions": versions() | ({} if results.fit is None else _engine_versions()),
            "seed": settings.seed,
            "date": date_of(runner.folder.path),
            "settings": settings.as_dict(),
            "timings": {name: round(seconds, 3) for name, seconds in runner.folder.timings.items()},
        },
    )
    return replace(results, judgement=judge(results))


def _engine_versions() -> dict[str, str]:
    from sysid.vehicle_model.engine import engine_versions

    return engine_versions()


def _with(results: Results, stage: Stage[Any], result: Any) -> Results:
    if stage.put is None:
        return replace(results, further={**results.further, stage.name: result})
    return stage.put(results, result)


def _status(results: Results, settings: Settings) -> Status:
    if settings.quick:
        return "preview"
    done = results.fit is not None and results.fit.converged
    return "converged" if done and results.posterior is not None and results.posterior.converged else "not_converged"


def _general_warnings(results: Results, settings: Settings) -> list[str]:
    if settings.quick:
        return [
            "Preview: few iterations and a short chain, suspension laws that were not tried against simpler ones, "
            "drops beside bump runs not fitted by the full model; run without --quick before using any number."
        ]
    if results.posterior is None:
        return ["The posterior has not been sampled: there are no credible intervals yet."]
    return []
