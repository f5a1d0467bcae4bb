"""The peers that are installed, each at the loosest tolerance that reaches the accuracy asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.peers.constants import Acquisition, our_signals, run_constants, worst_error
from benchmarks.rounds import Contender, timed
from benchmarks.work import Work

#: Relative RMS error of the worst channel of any run that everyone must reach.
ACCURACY = 1e-4
TOLERANCES = (1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 1e-9)
#: Peers take part in every so many rounds.
PEER_EVERY = 3
#: A batch of 64 is no cheaper per set and takes gigabytes.
DIFFRAX_BATCHES = (1, 16)
#: Peers give their signals to the filter at so many times the steps of our engine.
FINER = 2


@dataclass(frozen=True)
class Accuracy:
    """Tolerance of a solver, None for fixed steps, and relative RMS error of its worst channel."""

    tolerance: float | None
    worst_channel: float


@dataclass(frozen=True)
class Peers:
    """Reference signals, accuracy of everyone, contenders, and what is not installed."""

    reference: str
    accuracy: dict[str, Accuracy]
    contenders: list[Contender]
    missing: list[str]


def find_peers(work: Work, wanted: bool) -> Peers:
    """Check the accuracy of our engines and of all installed peers, and make contenders of the latter."""
    # At the points that our engine takes, parabolas through the corners of their signals would be 1.4e-4 off.
    runs, acquisition = run_constants(work), Acquisition(work, FINER * work.model.shapes[0].substeps)
    have_numba = wanted and find_spec("numba") is not None
    missing = [name for name in ("numba", "sksundae", "diffrax") if find_spec(name) is None] if wanted else []
    if have_numba:
        from benchmarks.peers import steppers

        reference_name = "DOP853 of SciPy at a relative tolerance of 1e-11, right-hand side in numba"
        solve = steppers.scipy_solver("DOP853", 0.005)
        fine = Acquisition(work, 2 * acquisition.substeps)
        reference = steppers.run_signals(solve, runs, fine, 1e-11)
    else:
        reference_name = "our engine with 16 times as many steps (numba is not installed)"
        reference = our_signals(work, "native", 16)
    accuracy = {
        f"{name} engine": Accuracy(None, worst_error(our_signals(work, name), reference)) for name in ("native", "jax")
    }
    contenders: list[Contender] = []

    def add(name: str, signals: Callable[[float], np.ndarray]) -> float | None:
        """Choose the tolerance; the contender's work includes the squares of its residuals."""
        errors = {}
        for tolerance in TOLERANCES:
            errors[tolerance] = worst_error(signals(tolerance), reference)
            if errors[tolerance] <= ACCURACY:
                break
        accuracy[name] = Accuracy(tolerance, errors[tolerance])
        return tolerance if errors[tolerance] <= ACCURACY else None

    squares, unfiltered = _squares(work), Acquisition(work, filtered=False)
    if have_numba:
        solvers = {"LSODA": steppers.scipy_solver("LSODA")}
        if "sksundae" not in missing:
            solvers |= {f"CVODE {method}": steppers.sundials_solver(method) for method in ("BDF", "Adams")}
        for name, one in solvers.items():
            signals = lambda t, one=one: steppers.run_signals(one, runs, acquisition, t)  # noqa: E731
            chosen = add(name, signals)
            if chosen is None:
                continue
            for label, seen in ((name, acquisition), (f"{name}, unfiltered", unfiltered)):
                call = lambda one=one, s=seen, t=chosen: squares(steppers.run_signals(one, runs, s, t))  # noqa: E731
                contenders.append(Contender(label, timed(call), every=PEER_EVERY))
    if wanted and "diffrax" not in missing:
        contenders += _diffrax(runs, acquisition, unfiltered, add, squares)
    return Peers(reference_name, accuracy, contenders, missing)


def _diffrax(runs: Any, acquisition: Any, unfiltered: Any, add: Any, squares: Any) -> list[Contender]:
    from benchmarks.peers.diffrax_solver import diffrax_batch

    alone = diffrax_batch(runs, acquisition, 1)
    chosen = add("diffrax Tsit5", lambda t: alone(t)[:, 0])
    if chosen is None:
        return []
    found = []
    kinds = [(f"{sets}", acquisition, sets) for sets in DIFFRAX_BATCHES]
    kinds.append((f"{DIFFRAX_BATCHES[-1]}, unfiltered", unfiltered, DIFFRAX_BATCHES[-1]))
    for label, seen, sets in kinds:
        batch = diffrax_batch(runs, seen, sets)

        def call(batch: Any = batch) -> object:
            return squares(batch(chosen))

        call()
        found.append(Contender(f"diffrax Tsit5, {label}", timed(call), sets, PEER_EVERY))
    return found


def _squares(work: Work) -> Callable[[np.ndarray], float]:
    """Sum of squared residuals of signals (T, ..., R, C); offsets and gains are not asked of peers."""
    arrays, noise = work.model.arrays[0], work.state.point.weights.noise_sd[0]
    weight = arrays.measured / noise

    def total(signals: np.ndarray) -> float:
        shown = signals[:, None] if signals.ndim == 3 else signals
        return float((((shown - arrays.value[:, None]) * weight[:, None]) ** 2).sum())

    return total
