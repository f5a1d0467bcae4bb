"""What a campaign file declares, without its logs: read and checked before anything else is loaded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sysid import limits
from sysid.campaign.inputs import paths
from sysid.errors import CampaignError
from sysid.wording import shorten

if TYPE_CHECKING:
    from sysid.campaign.toml import schema as s
    from sysid.campaign.toml.vehicle_tables import VehicleReader
    from sysid.logs.input_file import InputFile


@dataclass(frozen=True)
class Declared:
    """A campaign file with its validated tables, and its vehicle and load cases as records."""

    content: InputFile
    tables: s.CampaignFile
    vehicle: VehicleReader

    @property
    def file(self) -> Path:
        """The campaign file."""
        return self.content.path


def read_declared(path: str | Path, *, unfinished: bool = False) -> Declared:
    """Read a campaign file and check all that it says by itself.

    Parameters
    ----------
    path : the campaign file, or the folder that holds a `campaign.toml`.
    unfinished : take a file with values that are still to be filled in.

    Raises
    ------
    CampaignError
        If the file is missing, is wrong or has values to fill in.
    """
    content = paths.campaign_file(path)
    # pydantic takes a third of a second to import; those who only need the records do not pay for it.
    from sysid.campaign.toml.reading import parse_toml, validate
    from sysid.campaign.toml.stand_ins import with_stand_ins
    from sysid.campaign.toml.todo import refuse_todos

    name = content.path.name
    parsed = parse_toml(content.data, name)
    unknown: frozenset[str] = frozenset()
    if unfinished:
        parsed, unknown = with_stand_ins(parsed, name)
    else:
        refuse_todos(parsed, name)
    tables = validate(parsed, name)
    from sysid.campaign.mass_sums import check_masses
    from sysid.campaign.toml.vehicle_tables import VehicleReader

    vehicle = VehicleReader(tables, name)
    try:
        check_masses(vehicle.vehicle, {n: c for n, c in vehicle.load_cases.items() if n not in unknown})
    except CampaignError as error:
        raise CampaignError(f"{name}: {error}") from None
    return Declared(content, tables, vehicle)


def check_declared(path: str | Path) -> Declared:
    """The campaign file, if nothing is wrong with it and the names in it: in a fraction of the time its logs take.

    Raises
    ------
    CampaignError
        As :func:`read_declared`, or if a log or scan that the file names does not exist.
    """
    declared = read_declared(path)
    _check_names(declared)
    for key, name in _named_files(declared.tables):
        label = f"{declared.file.name}: {key}"
        paths.check_name(name, label)
        if not (declared.file.parent / name).is_file():
            # This says what is wrong, and which name was meant.
            paths.input_file(declared.file.parent, name, label, limits.LOG_BYTES)
    return declared


def _check_names(declared: Declared) -> None:
    """Refuse an unknown name of a load case, an axle, a body, a bump or a bridge, as its reader does after the logs."""
    tables, vehicle = declared.tables, declared.vehicle
    known = {
        "load_case": ("load case", list(vehicle.load_cases)),
        "axle": ("axle", [axle.name for axle in vehicle.vehicle.axles]),
        "body": ("body", [body.name for body in vehicle.vehicle.bodies]),
        "bump": ("scan", list(tables.scan)),
        "bridge": ("bridge", list(tables.bridge)),
    }
    for key, entry in _entries(tables):
        for field, (what, names) in known.items():
            name = getattr(entry, field, None)
            # Where the file has none at all, its reader says what is missing.
            if name is not None and names:
                vehicle.pick(name, names, f"{key}.{field}", what)


def _entries(tables: s.CampaignFile) -> Iterator[tuple[str, object]]:
    """Tests, and sensors that are used, with their keys."""
    for kind in ("plank_drop", "bump_run", "road_drive", "prediction"):
        for i, test in enumerate(getattr(tables.tests, kind)):
            yield f"tests.{kind}[{i + 1}]", test
    for kind in ("bump_run", "plank_drop"):
        for column, sensor in getattr(tables.sensors, kind).items():
            if sensor.unused is None:
                yield f"sensors.{kind}.{shorten(column)}", sensor


def _named_files(tables: s.CampaignFile) -> Iterator[tuple[str, str]]:
    """Keys of the logs that a campaign file names, and their names, in the order in which they are read."""
    tests = tables.tests
    for i, drop in enumerate(tests.plank_drop):
        yield f"tests.plank_drop[{i + 1}].file", drop.file
    for i, run in enumerate(tests.bump_run):
        if run.file is not None:
            yield f"tests.bump_run[{i + 1}].file", run.file
