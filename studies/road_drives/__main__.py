"""`python -m studies.road_drives [TRUCKS] [SEED]`: errors of k, c and load coefficients, and what intervals hold."""

from __future__ import annotations

import sys
import time

import numpy as np

from studies.road_drives.trucks import CLASSES, SETTLING_S, STEP_S, G, Motion, campaign, draw, drive
from sysid.balance import balance_forces

DRIVES = [(16.7, "B"), (11.1, "C"), (22.2, "B")]


def main(trucks: int = 40, seed: int = 1) -> None:
    """Print one line per truck and the sums."""
    errors: dict[str, list[float]] = {"stiffness": [], "damping": [], "load coefficient": []}
    held: dict[str, list[bool]] = {name: [] for name in errors}
    rngs = [np.random.default_rng([seed, number]) for number in range(trucks)]
    drawn = [draw(rng) for rng in rngs]
    motions: dict[int, list[Motion]] = {}
    for axles in sorted({t.x.size for t in drawn}):
        chosen = [i for i, t in enumerate(drawn) if t.x.size == axles for _ in DRIVES]
        made = drive([drawn[i] for i in chosen], [v for v, _ in DRIVES] * (len(chosen) // len(DRIVES)),
                     [CLASSES[name] for _, name in DRIVES] * (len(chosen) // len(DRIVES)),
                     [rngs[i] for i in chosen])  # fmt: skip
        for i, motion in zip(chosen, made, strict=True):
            motions.setdefault(i, []).append(motion)
    for number, (truck, rng) in enumerate(zip(drawn, rngs, strict=True)):
        given = campaign(truck, [(v, m) for (v, _), m in zip(DRIVES, motions[number], strict=True)], rng)
        begun = time.process_time()
        found = balance_forces(given)
        seconds = time.process_time() - begun
        line = []
        for e in found.estimates:
            true = float((truck.k if e.quantity == "stiffness" else truck.secant)[e.axle])
            errors[e.quantity].append(e.value / true - 1.0)
            held[e.quantity].append(e.low <= true <= e.high)
            line.append(f"{e.name} {100 * errors[e.quantity][-1]:+.1f}{'' if held[e.quantity][-1] else '!'}")
        after = int(SETTLING_S / STEP_S)
        for loads, motion in zip(found.loads, motions[number], strict=True):
            true = motion.load[after:].std(axis=0) / (truck.load_kg * G)
            errors["load coefficient"] += (loads.coefficient / true - 1.0).tolist()
            held["load coefficient"] += ((loads.low <= true) & (true <= loads.high)).tolist()
        state = "" if found.converged else "not converged, "
        sys.stdout.write(f"{number + 1:2d} {seconds:4.1f} s {found.rounds:2d} rounds, {state}{', '.join(line)}\n")
        sys.stdout.flush()
    for name, values in errors.items():
        size, share = 100.0 * np.abs(values), np.mean(held[name])
        sys.stdout.write(
            f"{name}: off by {np.median(size):.1f} % (median), {np.quantile(size, 0.9):.1f} % (90 % are below), "
            f"{size.max():.1f} % (worst); 90 % intervals hold {share:.0%} of {size.size}\n"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
