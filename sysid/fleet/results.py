"""Everything that is computed from the results of a whole fleet: populations and loads, and the file they stand in."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from sysid.cell_progress import watched_cell
from sysid.errors import DataRejectedError
from sysid.fleet.assembly import populations
from sysid.fleet.loads import PopulationLoad, population_loads
from sysid.fleet.members import Member, members
from sysid.fleet.population import TypePopulation
from sysid.fleet.population_file import write_population
from sysid.fleet.read import read_fleet
from sysid.fleet.records import Fleet
from sysid.fleet.running import Row, campaign_output
from sysid.fleet.status import rows_on_disk
from sysid.fleet.summaries import read_ahead
from sysid.progress import Progress


@dataclass(frozen=True)
class FleetResults:
    """Populations of all types, axle loads, sentences about what to know of them, and the file that was written.

    `rows` are all campaigns as they were when the populations were computed; `doubtful` those that count although
    nobody should bet on their numbers.
    """

    fleet: Fleet
    populations: tuple[TypePopulation, ...]
    loads: tuple[PopulationLoad, ...]
    remarks: tuple[str, ...]
    file: Path
    rows: tuple[Row, ...] = ()
    doubtful: tuple[Member, ...] = ()


def compute(
    path: str | Path,
    output: Path,
    progress: Progress | None = None,
    *,
    with_doubtful: bool = False,
    without_population: bool = False,
) -> FleetResults:
    """Populations of a fleet that has been run, written to ``fleet_population.json``.

    Parameters
    ----------
    progress : callback (message, fraction); without one a notebook shows a line below its cell.
    with_doubtful : take campaigns too on whose numbers nobody should bet.
    without_population : give results also where no type has enough trucks: remarks say why.

    Raises
    ------
    CampaignError
        If the fleet file is wrong.
    DataRejectedError
        If no type has enough trucks with results, unless `without_population`.
    OutputError
        If the folder cannot be written.
    """
    fleet = read_fleet(path)
    read_ahead([campaign_output(output, campaign.name) for _, campaign in fleet.campaigns()])
    # Once for all: the files of all campaigns are hashed.
    rows = tuple(rows_on_disk(fleet, output))
    kinds = dict.fromkeys(t.type for t in fleet.trucks)
    of_types = {kind: members(fleet, output, kind, with_doubtful, rows) for kind in kinds}
    with watched_cell(["population"]) if progress is None else nullcontext(progress) as said_to:
        by_type, said = populations(of_types.values(), fleet.shared, progress=said_to)
    if not by_type and not without_population:
        raise DataRejectedError(" ".join(said[:3]) or "The fleet has no campaign with results; run it first.")
    remarks = [*fleet.messages, *said]
    loads: list[PopulationLoad] = []
    for p in by_type:
        of_type, said = population_loads(p.type, of_types[p.type].campaigns)
        loads += of_type
        remarks += said
    doubtful = tuple(m for of_type in of_types.values() for m in of_type.campaigns if m.doubtful)
    file = write_population(by_type, loads, remarks, output, [m.campaign for m in doubtful])
    return FleetResults(fleet, tuple(by_type), tuple(loads), tuple(remarks), file, rows, doubtful)
