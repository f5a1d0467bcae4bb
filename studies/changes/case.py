"""One pair: a truck by independent equations, driven twice; before the second time one of its dampers may change."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.independent.case import KINDS

SEED = 20261128
#: Change of one damper in every second pair, down and up in turn.
CHANGE = 0.1
_SUPPORT = Path(__file__).resolve().parents[2] / "tests" / "support"


def physics_of(number: int) -> str:
    """Physics of a pair: all kinds of trucks in turn, changed and unchanged ones of each."""
    kind, turn = (number // 2) % len(KINDS), number // (2 * len(KINDS))
    every = KINDS[list(KINDS)[kind]]
    return every[turn % len(every)]


def write_pair(folder: Path, number: int, seed: int = SEED) -> Record:
    """Write the campaigns ``before`` and ``after`` of a pair below a folder; the truth behind them.

    Noise, offsets, gains, speeds and starts of the second campaign are drawn anew; masses, tires, and what the campaign
    files say of them, are the same.
    """
    sys.path.insert(0, str(_SUPPORT))
    from independent_campaign import write_truck_campaign
    from independent_physics import CORRELATION, PASSES, SPEEDS, declared_truck, true_truck
    from independent_physics import KINDS as PHYSICS

    kind = physics_of(number)
    physics, rng = PHYSICS[kind], np.random.default_rng([seed, number])
    declared = declared_truck("three axles", physics)
    truck = true_truck(declared, physics, rng)
    axle = int(rng.integers(len(truck.damping)))
    factor = 1.0 + (CHANGE if number % 4 == 2 else -CHANGE) if number % 2 == 0 else 1.0
    damping = tuple(c * (factor if i == axle else 1.0) for i, c in enumerate(truck.damping))
    for name, one, noise in (("before", truck, 0), ("after", replace(truck, damping=damping), 1)):
        write_truck_campaign(
            folder / name,
            one,
            speeds=SPEEDS["three axles"],
            changes=(physics.change,),
            load_shift=bool(physics.change),
            predicted=PASSES,
            written=replace(declared, elements=one.elements),
            correlation=CORRELATION,
            outliers=physics.outliers,
            seed=2 * (1000 * seed + number) + noise,
        )
    return {"number": number, "physics": kind, "axle": axle + 1, "factor": factor}


def replicate(number: int, seed: int = SEED) -> Record:
    """What `compare` says of the fits of both campaigns of a pair, beside the truth."""
    with tempfile.TemporaryDirectory() as place:
        return compared_pair(Path(place), number, seed)


def compared_pair(folder: Path, number: int, seed: int) -> Record:
    """The same in a folder that stays."""
    from sysid import Calibration
    from sysid.comparison import compare
    from sysid.errors import SysidError

    record = write_pair(folder, number, seed)
    try:
        for name in ("before", "after"):
            calibration = Calibration(folder / name, folder / f"fit_{name}")
            calibration.fit()
            calibration.export()
        (pair,) = compare(folder / "fit_before", folder / "fit_after").pairs
    except SysidError as error:
        return {**record, "failed": str(error), "entries": []}
    return {**record, "failed": None, **differences(pair, record["axle"], record["factor"])}


def differences(pair, axle: int, factor: float) -> Record:
    """Log ratios of k and c with their standard deviations and the truth, and what is called changed."""
    entries = [
        {
            "name": d.name,
            "quantity": d.quantity,
            "truth": float(np.log(factor)) if (d.quantity, d.axle) == ("damping", axle) else 0.0,
            "log_ratio": d.log_ratio,
            "log_sd": d.log_sd,
            "changed": d.changed,
        }
        for d in pair.differences
        if d.quantity in ("stiffness", "damping")
    ]
    others = [d.name for d in pair.of("suspension") if d.changed and d.quantity not in ("stiffness", "damping")]
    return {
        "entries": entries,
        "also": others,
        "shared": list(pair.shared),
        "remarks": list(pair.remarks),
        "undecided": pair.undecided,
    }
