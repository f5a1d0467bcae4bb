"""Everything that is computed from the results of a whole fleet: populations and loads, and the file they stand in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sysid.fleet.assembly import members, populations
from sysid.fleet.loads import PopulationLoad, population_loads
from sysid.fleet.population import TypePopulation
from sysid.fleet.population_file import write_population
from sysid.fleet.read import read_fleet
from sysid.fleet.records import Fleet
from sysid.progress import Progress


@dataclass(frozen=True)
class FleetResults:
    """Populations of all types, wheel loads, sentences about what was left out, and the file that was written."""

    fleet: Fleet
    populations: tuple[TypePopulation, ...]
    loads: tuple[PopulationLoad, ...]
    remarks: tuple[str, ...]
    file: Path


def compute(path: str | Path, output: Path, progress: Progress | None = None) -> FleetResults:
    """Populations of a fleet that has been run, written to ``fleet_population.json``.

    Raises
    ------
    CampaignError
        If the fleet file is wrong.
    DataRejectedError
        If no type has enough trucks with results.
    OutputError
        If the folder cannot be written.
    """
    fleet = read_fleet(path)
    by_type, remarks = populations(fleet, output, progress=progress)
    remarks = [*fleet.messages, *remarks]
    loads: list[PopulationLoad] = []
    for p in by_type:
        of_type, said = population_loads(p.type, members(fleet, output, p.type))
        loads += of_type
        remarks += said
    file = write_population(by_type, loads, remarks, output)
    return FleetResults(fleet, tuple(by_type), tuple(loads), tuple(remarks), file)
