"""``fleet_population.json``: populations, trucks, outliers and loads in SI; what is not known is null."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sysid.files import write_text
from sysid.fleet.loads import PopulationLoad
from sysid.fleet.population import Quantiles, TypePopulation
from sysid.folder_lock import writing_to

POPULATION_JSON = "fleet_population.json"
#: Version of the file; a number up whenever a key changes its meaning or goes.
SCHEMA = 1


def population_document(
    populations: Sequence[TypePopulation],
    loads: Sequence[PopulationLoad],
    remarks: Sequence[str],
    doubtful: Collection[str] = (),
) -> dict[str, Any]:
    """The content of the file as plain Python objects; `doubtful` campaigns are those that nobody should bet on."""
    return {
        "schema": SCHEMA,
        "types": [_type(p, frozenset(doubtful)) for p in populations],
        "loads": [asdict(load) for load in loads],
        "remarks": list(remarks),
    }


def write_population(
    populations: Sequence[TypePopulation],
    loads: Sequence[PopulationLoad],
    remarks: Sequence[str],
    output: Path,
    doubtful: Collection[str] = (),
) -> Path:
    """Write the file below `output`, with campaigns marked that are `doubtful`.

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    document = population_document(populations, loads, remarks, doubtful)
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    with writing_to(output):
        write_text(output / POPULATION_JSON, text + "\n")
    return output / POPULATION_JSON


def _type(p: TypePopulation, doubtful: Collection[str]) -> dict[str, Any]:
    return {
        "type": p.type,
        "converged": p.converged,
        "message": p.message,
        "remarks": list(p.remarks),
        "parameters": [
            {
                "name": name,
                "quantity": p.quantities[i],
                "unit": p.units[i],
                "mean": _at(p.mean, i),
                "new_truck": _at(p.new, i),
                "spread": _at(p.spread, i),
                "scatter": _at(p.scatter, i),
                "further_trucks_to_halve": _number(p.further[i]),
            }
            for i, name in enumerate(p.names)
        ],
        "correlation": np.round(p.correlation, 4).tolist(),
        "trucks": [
            {
                "name": truck,
                "parameters": [
                    {"name": name, "alone": _at(p.alone, (t, i)), "with_population": _at(p.trucks, (t, i))}
                    for i, name in enumerate(p.names)
                ],
            }
            for t, truck in enumerate(p.truck_names)
        ],
        "outliers": [asdict(o) for o in p.outliers],
        "shared": [{"name": n, "mean": mean, "sd": sd} for n, (mean, sd) in p.shared.items()],
        "campaigns": [
            {"name": name, "pareto_k": _number(k), "doubtful": name in doubtful}
            for name, k in zip(p.campaigns, p.pareto_k, strict=True)
        ],
        "correction": {"pareto_k": _number(p.correction_k), "applied": p.corrected},
    }


def _at(q: Quantiles, index: Any) -> dict[str, float | None]:
    return {name: _number(getattr(q, name)[index]) for name in ("q05", "q50", "q95")}


def _number(value: Any) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None
