"""Reader of a campaign: from campaign.toml and the files it names to records in SI units."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sysid import limits
from sysid.campaign.bridges import BridgeCourse, BridgeDescription
from sysid.campaign.clocks.common import on_common_clock
from sysid.campaign.declared import read_declared
from sysid.campaign.inputs import paths
from sysid.campaign.inputs.bridges import described_bridge
from sysid.campaign.inputs.bumps import PointCloudReader, ProfileReader, RoadReader, read_bumps
from sysid.campaign.inputs.named_files import NamedFiles
from sysid.campaign.inputs.run_logs import RunLogs, log_writing
from sysid.campaign.loggers import ClockFinding
from sysid.campaign.passage.logged_speed import speed_at_bump
from sysid.campaign.priors import NamedPrior
from sysid.campaign.records import (
    HOLD_S,
    Acquisition,
    AntiAliasFilter,
    BumpRun,
    BumpShape,
    Campaign,
    CampaignDetails,
    Log,
    PlankDrop,
    PredictionRequest,
    RoadDrive,
    Scan,
    Sensor,
)
from sysid.campaign.requests import check_passes
from sysid.campaign.roads import RoadCourse, with_obstacle
from sysid.campaign.units import speed_m_s
from sysid.campaign.vehicle_records import Vehicle
from sysid.campaign.wheel_places import tires_across
from sysid.errors import CampaignError
from sysid.logs.input_file import InputFile
from sysid.wording import shorten

if TYPE_CHECKING:
    from sysid.campaign.toml import schema as s
    from sysid.campaign.toml.vehicle_tables import VehicleReader

#: Columns that one sentence names.
_NAMED = 10


def read_campaign(
    path: str | Path,
    *,
    point_cloud_reader: PointCloudReader | None = None,
    profile_reader: ProfileReader | None = None,
    road_reader: RoadReader | None = None,
    planned: bool = False,
    unfinished: bool = False,
    only: Collection[str] | None = None,
) -> Campaign:
    """Read a campaign: check the file, resolve names, convert to SI, read and hash every input.

    Parameters
    ----------
    path : the campaign file, or the folder that holds a `campaign.toml`.
    point_cloud_reader : function (file, unit) -> points (n, 3) [m] that reads a scan; without it scans hold no points.
        The file has its content as `data` and can be used as a path.
    profile_reader : function (file, lateral place [m], name) -> bump that reads the profile of a prediction or of a
        bump that was not scanned; without it such bumps have no stations.
    road_reader : function (file, lateral place [m], name, length [m] or None) -> road that reads the rough road of a
        prediction; without it such roads have no heights.
    planned : take logs that do not exist for tests that are still to come: one blank reading of every declared sensor.
    unfinished : take a file with values that are still to be filled in, for the check of its logs only:
        :func:`sysid.campaign.toml.stand_ins.with_stand_ins`.
    only : names of logs; drops, runs and drives that name another one are left out. None takes all.

    Returns
    -------
    Campaign
        Axles sorted front to rear; load cases, drops, runs and predictions in the order of the file.

    Raises
    ------
    CampaignError
        If the campaign file is wrong or has values to fill in, or a file it names is missing or outside its folder.
    DataRejectedError
        If a log or scan cannot be read, or the clock of a logger is outside of its declared bounds.
    """
    declared = read_declared(path, unfinished=unfinished)
    content, file, vehicle = declared.content, declared.file, declared.vehicle
    tables = declared.tables if only is None else _of_logs(declared.tables, only)
    files = NamedFiles(file, tables.acquisition.sample_interval_s, {file.name: content.sha256}, planned)
    reader = _TestReader(file, tables, vehicle, files)
    scans = read_bumps(tables.scan, files, point_cloud_reader, profile_reader, tires_across(vehicle.vehicle))
    drops, (runs, clocks) = reader.plank_drops(), reader.bump_runs(scans)
    drives = reader.road_drives()
    bridges = reader.bridges(road_reader)
    acquisition = tables.acquisition
    low_pass = acquisition.filter
    return Campaign(
        title=tables.campaign.title,
        notes=tables.campaign.notes,
        folder=file.parent,
        file=file,
        vehicle=_held_as(vehicle.vehicle, runs),
        load_cases=vehicle.load_cases,
        acquisition=Acquisition(
            acquisition.sample_interval_s,
            None if low_pass is None else AntiAliasFilter(low_pass.type, low_pass.order, low_pass.cutoff_hz),
        ),
        plank_drops=drops,
        bump_runs=runs,
        scans=scans,
        predictions=reader.predictions(scans, profile_reader, road_reader, bridges),
        input_sha256=files.hashes,
        messages=reader.messages(),
        priors={name: NamedPrior(*table.lognormal()) for name, table in tables.priors.items()},
        clocks=clocks,
        details=CampaignDetails(
            None if tables.campaign.date is None else tables.campaign.date.isoformat(),
            tables.campaign.place,
            tables.campaign.operator,
            tables.campaign.vehicle_id,
            tables.campaign.synthetic,
            tables.campaign.scale,
        ),
        road_drives=drives,
        bridges=bridges,
    )


def _of_logs(tables: s.CampaignFile, only: Collection[str]) -> s.CampaignFile:
    tests = tables.tests

    def there(*names: str | None) -> bool:
        return all(paths.relative_name(name) in only for name in names if name is not None)

    kept = {
        "plank_drop": [entry for entry in tests.plank_drop if there(entry.file)],
        "bump_run": [entry for entry in tests.bump_run if there(entry.file, *entry.files.values())],
        "road_drive": [entry for entry in tests.road_drive if there(entry.file)],
    }
    return tables.model_copy(update={"tests": tests.model_copy(update=kept)})


def _held_as(vehicle: Vehicle, runs: Sequence[BumpRun]) -> Vehicle:
    """A vehicle that is driven by its wheels, with the time constant of its runs where these were held alike."""
    times = {HOLD_S[run.speed_held] for run in runs if run.speed_held not in ("towed", "free")}
    return replace(vehicle, hold_s=times.pop()) if vehicle.driven_at == "road" and len(times) == 1 else vehicle


@dataclass(frozen=True)
class _TestReader:
    file: Path
    tables: s.CampaignFile
    vehicle: VehicleReader
    files: NamedFiles

    def _load_case(self, name: str, key: str) -> str:
        return self.vehicle.pick(name, list(self.vehicle.load_cases), f"{key}.load_case", "load case")

    def plank_drops(self) -> tuple[PlankDrop, ...]:
        """Plank drops with their logs, in the order of the file; of a lifted body one for every axle with sensors.

        Raises
        ------
        CampaignError
            If sensors of drops, an axle, a load case or a file that a drop names are missing.
        DataRejectedError
            If a log cannot be read.
        """
        drops = []
        sensors = self.tables.sensors.plank_drop
        for i, entry in enumerate(self.tables.tests.plank_drop):
            key = self._key("plank_drop", i, sensors)
            names = [(entry.axle, f"{key}.axle")] if entry.axle is not None else []
            names += [(name, f"{key}.axles") for name in entry.axles]
            lifted = [self.vehicle.axle(name, where) for name, where in names]
            first = next(iter(self.vehicle.load_cases))
            load_case = first if entry.load_case is None else self._load_case(entry.load_case, key)
            speed = None if entry.nominal_speed_km_h is None else speed_m_s(entry.nominal_speed_km_h)
            writing = log_writing(self.tables.acquisition, entry)
            for index, at in self._drop_sensors(lifted, key).items():
                drops.append(
                    PlankDrop(
                        axle=index,
                        load_case=load_case,
                        plank_height_m=entry.plank_height_m,
                        log=self.files.log(entry.file, f"{key}.file", at, writing),
                        nominal_speed_m_s=speed,
                        dampers=entry.dampers,
                        towed=entry.towed,
                        engine_off=entry.engine_off,
                        release=entry.release,
                        lifted=tuple(lifted) if entry.release == "body" else (),
                    )
                )
        return tuple(drops)

    def _key(self, kind: str, place: int, sensors: Collection[object]) -> str:
        """Key of a test, whose kind must have sensors."""
        key = f"tests.{kind}[{place + 1}]"
        if not sensors:
            raise CampaignError(
                f"{self.file.name}: {key} needs [sensors.{kind}], which is missing; name the columns of its log there."
            )
        return key

    def _drop_sensors(self, lifted: list[int], key: str) -> dict[int, list[Sensor]]:
        """Sensors of one drop per axle under test; those without an axle of their own are at the only one."""
        sensors_of: dict[int, list[Sensor]] = {}
        for column, table in self.tables.sensors.plank_drop.items():
            if table.unused is not None:
                continue
            where = f"sensors.plank_drop.{shorten(column)}"
            if table.axle is not None:
                index = self.vehicle.axle(table.axle, f"{where}.axle")
                if index not in lifted:
                    continue
            elif len(lifted) > 1:
                raise CampaignError(
                    f"{self.file.name}: {key} has several axles, and {where} does not say at which it is mounted; "
                    "give it an axle."
                )
            else:
                index = lifted[0]
            axle = self.vehicle.vehicle.axles[index]
            # A body turns alike everywhere, but for bending.
            x_m = None if table.kind == "pitch_rate" else axle.x_m
            sensors_of.setdefault(index, []).append(_sensor(column, table, axle=index, body=axle.body, x_m=x_m))
        if not sensors_of:
            raise CampaignError(
                f"{self.file.name}: {key} has no sensor at its axle in [sensors.plank_drop]; name its column there."
            )
        return dict(sorted(sensors_of.items()))

    def bump_runs(self, scans: Mapping[str, Scan]) -> tuple[tuple[BumpRun, ...], tuple[ClockFinding, ...]]:
        """Bump runs with their logs, in the order of the file, and the clocks of further loggers.

        Raises
        ------
        CampaignError
            If sensors of runs, an axle, a body, a load case, a scan or a file that a run names are missing, or if a run
            does not say which of several bumps it crosses.
        DataRejectedError
            If a log cannot be read, or a clock is outside of its declared bounds.
        """
        runs, others = [], []
        sensors = self._run_sensors()
        logs = RunLogs(self.file.name, self.tables, self.files, sensors)
        for i, entry in enumerate(self.tables.tests.bump_run):
            key = self._key("bump_run", i, sensors)
            log, of_others = logs.read(entry, key)
            others.append(of_others)
            runs.append(
                BumpRun(
                    case=entry.case,
                    load_case=self._load_case(entry.load_case, key),
                    nominal_speed_m_s=self._speed(entry, key, log),
                    speed_listed=entry.nominal_speed_km_h is not None,
                    repeat=entry.repeat,
                    log=log,
                    bump=self._bump(entry.bump, key, scans),
                    speed_held=entry.speed_held,
                    speed_change_sd=entry.speed_change_sd,
                )
            )
        if not any(others):
            return tuple(runs), ()
        return on_common_clock(runs, others, logs.loggers, self.vehicle.vehicle)

    def road_drives(self) -> tuple[RoadDrive, ...]:
        """Road drives with their logs, in the order of the file.

        Raises
        ------
        CampaignError
            If sensors, a load case or a file that a drive names are missing, or nothing says how fast it was.
        DataRejectedError
            If a log cannot be read.
        """
        drives = []
        sensors = self._run_sensors() if self.tables.tests.road_drive else []
        for i, entry in enumerate(self.tables.tests.road_drive):
            key = f"tests.road_drive[{i + 1}]"
            if not sensors:
                raise CampaignError(
                    f"{self.file.name}: {key} needs [sensors.bump_run], which is missing; name the columns of its log "
                    "there."
                )
            log = self.files.log(entry.file, f"{key}.file", sensors, log_writing(self.tables.acquisition, entry))
            load_case = self._load_case(entry.load_case, key)
            drives.append(RoadDrive(load_case, self._speed(entry, key, log), log, entry.speed_held))
        return tuple(drives)

    def _speed(self, entry: s.BumpRunTable | s.RoadDriveTable, key: str, log: Log) -> float:
        if entry.nominal_speed_km_h is not None:
            return speed_m_s(entry.nominal_speed_km_h)
        logged = speed_at_bump(log)
        if logged is None:
            raise CampaignError(
                f"{self.file.name}: {key} has no nominal_speed_km_h, and no sensor of kind 'speed' in its log shows "
                "that the truck moves; give one of the two."
            )
        # Repeats have one nominal speed, as they would in a list.
        return speed_m_s(max(1.0, round(logged / speed_m_s(1.0))))

    def bridges(self, road_reader: RoadReader | None) -> dict[str, BridgeDescription]:
        """Bridges of the file with the files that they name.

        Raises
        ------
        CampaignError
            If a file that one names is missing.
        DataRejectedError
            If one cannot be used.
        """

        def content(name: str, key: str, file: str) -> InputFile:
            return self.files.content(file, f"bridge.{shorten(name)}.{key}", limits.PROFILE_BYTES)

        return {
            name: described_bridge(name, table, partial(content, name), road_reader)
            for name, table in self.tables.bridge.items()
        }

    def predictions(
        self,
        scans: Mapping[str, Scan],
        profile_reader: ProfileReader | None,
        road_reader: RoadReader | None,
        bridges: Mapping[str, BridgeDescription],
    ) -> tuple[PredictionRequest, ...]:
        """Passes to predict; bumps of different shape have different names.

        Raises
        ------
        CampaignError
            If a load case, a scan or a file that one names is missing, or a pass takes too long.
        DataRejectedError
            If the reader finds no bump in a file.
        """
        result = []
        named: dict[str, BumpShape] = {}
        for i, entry in enumerate(self.tables.tests.prediction):
            key = f"tests.prediction[{i + 1}]"
            load_case, speed = self._load_case(entry.load_case, key), speed_m_s(entry.speed_km_h)
            if entry.road is not None:
                road = self._road(entry.road, f"{key}.road", road_reader, profile_reader)
                result.append(PredictionRequest(load_case, speed, road.label, road=road))
                continue
            if entry.bridge is not None:
                bridge = bridges[self.vehicle.pick(entry.bridge, list(bridges), f"{key}.bridge", "bridge")]
                course = BridgeCourse(bridge, bridge.surface, entry.vehicles, entry.gap_m)
                result.append(PredictionRequest(load_case, speed, course.label, bridge=course))
                continue
            if entry.shape is None:
                result.append(PredictionRequest(load_case, speed, self._bump(entry.bump, key, scans)))
                continue
            shape = self._shape(entry.shape, f"{key}.shape", profile_reader)
            name, count = shape.label, 1
            while named.setdefault(name, shape) != shape:
                count += 1
                name = f"{shape.label} ({count})"
            result.append(PredictionRequest(load_case, speed, name, shape))
        check_passes(result, self.vehicle.vehicle, {}, self.file.name)
        return tuple(result)

    def _shape(self, table: s.ShapeTable, key: str, profile_reader: ProfileReader | None) -> BumpShape:
        if table.file is None:
            return table.bump()
        content = self.files.content(table.file, f"{key}.file", limits.PROFILE_BYTES)
        name = paths.relative_name(table.file)
        if profile_reader is None:
            return BumpShape("points", source=name)
        return profile_reader(content, table.lateral_m or 0.0, name)

    def _road(
        self,
        table: s.RoadTable,
        key: str,
        road_reader: RoadReader | None,
        profile_reader: ProfileReader | None = None,
    ) -> RoadCourse:
        if table.parts:
            parts = tuple(self._road(part, f"{key}.parts[{k + 1}]", road_reader) for k, part in enumerate(table.parts))
            road = RoadCourse(sum(p.length_m for p in parts), realisations=table.realisations, parts=parts)
        elif table.file is None:
            assert table.length_m is not None
            road = RoadCourse(table.length_m, table.roughness, table.seed, table.realisations)
        else:
            content = self.files.content(table.file, f"{key}.file", limits.PROFILE_BYTES)
            name = paths.relative_name(table.file)
            if road_reader is None:
                road = RoadCourse(table.length_m or 0.0, source=name)
            else:
                road = road_reader(content, table.lateral_m or 0.0, name, table.length_m)
        road = replace(road, stress_exponent=table.stress_exponent)
        if table.shape is not None:
            shape = self._shape(table.shape, f"{key}.shape", profile_reader)
            road = with_obstacle(road, shape, table.at_m or 0.0, table.sunken, f"{self.file.name}: {key}")
        return road

    def messages(self) -> tuple[str, ...]:
        """What somebody should know about the list of tests."""
        tests = self.tables.tests
        of_runs = [[f for f in (r.file, *r.files.values()) if f is not None] for r in tests.bump_run]
        names = [
            paths.relative_name(e) for e in [*(d.file for d in tests.plank_drop), *(f for fs in of_runs for f in fs)]
        ]
        said: dict[str, tuple[str, float | None]] = {}
        for run, name in (
            (r, paths.relative_name(f)) for r, fs in zip(tests.bump_run, of_runs, strict=True) for f in fs
        ):
            of_run = (run.load_case, run.nominal_speed_km_h)
            if said.setdefault(name, of_run) != of_run:
                raise CampaignError(
                    f"{self.file.name}: {shorten(name, 100)} is listed as two runs of different load case or speed; "
                    "one of the two must be another file."
                )
        twice = sorted({n for n in names if names.count(n) > 1}) if len(names) <= 2000 else []
        result = [f"{shorten(n, 100)} is named by more than one test: its data count more than once." for n in twice]
        result += self._unused()
        if not names:
            result.append("The campaign has neither plank drops nor bump runs.")
        return tuple(result)

    def _unused(self) -> list[str]:
        """Sentences about sensors that campaign.toml says not to use, one per reason."""
        columns: dict[str, dict[str, None]] = {}
        for tables in (self.tables.sensors.bump_run, self.tables.sensors.plank_drop):
            for column, table in tables.items():
                if table.unused is not None:
                    columns.setdefault(table.unused, {})[column] = None
        said = []
        for reason, of_reason in columns.items():
            names = ", ".join(repr(shorten(c)) for c in list(of_reason)[:_NAMED])
            more = f" and {len(of_reason) - _NAMED} more" if len(of_reason) > _NAMED else ""
            said.append(f"Not used, as {self.file.name} says ({shorten(reason, 100)}): {names}{more}.")
        return said

    def _run_sensors(self) -> list[Sensor]:
        result = []
        for column, table in self.tables.sensors.bump_run.items():
            if table.unused is not None:
                continue
            key = f"sensors.bump_run.{shorten(column)}"
            axle = None if table.axle is None else self.vehicle.axle(table.axle, f"{key}.axle")
            body = None if table.body is None else self.vehicle.body(table.body, f"{key}.body")
            x_m = table.x_m
            if table.kind == "body_acceleration" and axle is not None:
                # Above an axle: at the place of that axle, on the body that it carries.
                above = self.vehicle.vehicle.axles[axle]
                axle, body, x_m = None, above.body, above.x_m
            sensor = _sensor(column, table, axle=axle, body=body, x_m=x_m)
            result.append(replace(sensor, logger=table.logger or "", source=(table.column or "").strip()))
        return result

    def _bump(self, name: str | None, key: str, scans: Mapping[str, Scan]) -> str:
        label = self.file.name
        if not scans:
            raise CampaignError(f"{label}: {key} needs a scan of its bump, but [scan] is missing; add it.")
        if name is not None:
            return self.vehicle.pick(name, list(scans), f"{key}.bump", "scan")
        if len(scans) > 1:
            raise CampaignError(
                f"{label}: {key} does not say which bump it crosses; add bump = "
                f"{' or '.join(repr(shorten(n)) for n in list(scans)[:5])}."
            )
        return next(iter(scans))


def _sensor(
    column: str,
    table: s.RunSensorTable | s.DropSensorTable,
    axle: int | None,
    body: int | None,
    x_m: float | None,
) -> Sensor:
    assert table.kind is not None
    assert table.unit is not None
    sensor = Sensor(
        column=column.strip(),
        kind=table.kind,
        unit=table.unit.strip(),
        axle=axle,
        body=body,
        x_m=x_m,
        side=table.side or (None if not table.y_m else "left" if table.y_m > 0.0 else "right"),
        y_m=table.y_m,
        sign=table.sign,
        scale=table.scale,
        area_m2=table.area_m2,
    )
    return sensor if table.range is None else replace(sensor, full_scale=table.range * sensor.unit_in_si)
