"""The stages of the benchmark in order, and what they find as one dictionary ready for JSON."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import likelihood, processes
from benchmarks.bare_kernel import BareKernel, compile_program
from benchmarks.growth import measure_growth
from benchmarks.machine import describe
from benchmarks.peers.catalogue import find_peers
from benchmarks.rounds import Contender, Spread, ratio, run_rounds, spread
from benchmarks.work import Work, density, fitted_point, linear_truck, make_work, nominal_point

Say = Callable[[str], None]
#: Runs of the comparison: both load cases at 16 km/h, twice each, records of one length.
RUNS = (0, 1, 8, 9)
MEASURES = ("wall_s", "processor_s")
#: No further round of the comparison is begun after this.
ROUNDS_LIMIT_S = 150.0


@dataclass(frozen=True)
class Plan:
    """Where to write and how much to do."""

    output: Path
    quick: bool = False
    peers: bool = True
    rounds: int = 12


def measure(plan: Plan, say: Say) -> dict[str, Any]:
    """All stages; every value is a number, a text, or a list or dictionary of these."""
    found: dict[str, Any] = {"machine": describe(), "quick": plan.quick}
    if plan.quick:
        point = nominal_point()
    else:
        say("complete fits, cold and warm")
        found["fit"] = processes.complete_fits(plan.output)
        point = fitted_point(plan.output / "fit-warm")
    work = make_work(point, RUNS[:1] if plan.quick else RUNS)
    found["work"] = {
        "runs": [run.log.file for run in work.campaign.bump_runs],
        "simulated_s": work.simulated_s,
        "parameters": len(work.model.parameters.parameters),
        "channels": int(work.model.arrays[0].value.shape[2]),
        "step_s": work.model.shapes[0].interval_s / work.model.shapes[0].substeps,
    }
    found |= _comparison(plan, work, say)
    say("growth")
    found["growth"] = measure_growth(point, 1 if plan.quick else 5, 60.0)
    say("imports")
    found["imports"] = processes.imports(1 if plan.quick else 7, 60.0)
    if not plan.quick:
        say("memory of a batch of 256 sets")
        found["memory"] = processes.memory(("native", "jax"), len(linear_truck()[0].bump_runs))
        say("first likelihood with empty and full caches")
        found["start_up"] = processes.first_likelihoods(plan.output, ("native", "jax"), 3)
    found["machine"]["load_after"] = os.getloadavg()[0]
    return found


def _comparison(plan: Plan, work: Work, say: Say) -> dict[str, Any]:
    """Accuracy of everyone, then seconds and ratios."""
    say("accuracy")
    peers = find_peers(work, plan.peers)
    say("compiling")
    batches = (1, 16) if plan.quick else likelihood.BATCHES
    batch = max(b for b in batches if b <= 64)
    ours = density(work, "native")
    program = BareKernel(compile_program(plan.output), plan.output, work, ours, [work.sets(n) for n in batches])
    agreement = _agreement(program, work, ours, batches)
    contenders = [
        *likelihood.likelihoods(work, ours, "native", batches, 1),
        *likelihood.bare(program, batches),
        likelihood.simulation(work, "native"),
        likelihood.jacobian(work, "native"),
        likelihood.posterior(work, ours),
        *peers.contenders,
    ]
    if not plan.quick:
        every = likelihood.JAX_EVERY
        jax_density = density(work, "jax")
        contenders += [
            *likelihood.likelihoods(work, jax_density, "jax", batches, every),
            likelihood.simulation(work, "jax", every),
            likelihood.jacobian(work, "jax", 2 * every),
        ]
    say(f"comparison of {len(contenders)}")
    done = run_rounds(contenders, 2 if plan.quick else plan.rounds, ROUNDS_LIMIT_S)
    program.close()
    return {
        "accuracy": {
            "reference": peers.reference,
            "worst_channel": {name: asdict(a) for name, a in peers.accuracy.items()},
            "kernel_misfit_difference": agreement,
        },
        "missing_peers": peers.missing,
        "rounds": done,
        "seconds": {c.name: {what: spread(list(c.per_unit(what).values())) for what in MEASURES} for c in contenders},
        "ratios": _ratios({c.name: c for c in contenders}, batch),
    }


def _agreement(program: BareKernel, work: Work, ours: Any, batches: tuple[int, ...]) -> float:
    """Relative difference between the misfits of the bare kernel and of the product, priors taken off."""
    sets = work.sets(batches[-1])
    prior = ((sets @ ours._rows.T - ours._targets) ** 2).sum()
    product = float((-2.0 * ours(sets)).sum() - prior)
    return abs(program.measure(len(batches) - 1)[1] / product - 1.0)


def _ratios(by_name: dict[str, Contender], batch: int) -> dict[str, dict[str, Spread]]:
    pairs = {
        "likelihood / kernel": (f"native {batch}", f"kernel {batch}"),
        "one simulation / kernel per set": ("native simulation", f"kernel {batch}"),
        "Jacobian / likelihood": ("native Jacobian", f"native {batch}"),
        "JAX likelihood / kernel": (f"jax {batch}", f"kernel {batch}"),
        "JAX one simulation / kernel per set": ("jax simulation", f"kernel {batch}"),
        "JAX Jacobian / JAX likelihood": ("jax Jacobian", f"jax {batch}"),
    }
    peers = [name for name in by_name if name.startswith(("diffrax", "CVODE", "LSODA"))]
    pairs |= {f"{name} / likelihood": (name, f"native {batch}") for name in peers}
    return {
        label: {what: ratio(by_name[one], by_name[other], what) for what in MEASURES}
        for label, (one, other) in pairs.items()
        if one in by_name and other in by_name
    }
