"""The whole campaign looked at together: what runs, drops, scan and list say about each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from sysid.bookkeeping.drives import drive_complaints
from sysid.bookkeeping.drops import drop_complaints
from sysid.bookkeeping.elimination import sentences
from sysid.bookkeeping.force_balance import run_spectra
from sysid.bookkeeping.masses import mass_complaints
from sysid.bookkeeping.measured import measured_values
from sysid.bookkeeping.names import name_complaints
from sysid.bookkeeping.places import Places, place_complaints, runs_without_bump, second_passes
from sysid.bookkeeping.pressures import pressure_complaints
from sysid.bookkeeping.sampling import sampling_complaints
from sysid.bookkeeping.sensors import SensorFault, place_of_frame_sensors, sensor_complaints
from sysid.bookkeeping.sides import one_sided_sentence
from sysid.bookkeeping.usual import BALANCED, MASSES, declared_values
from sysid.bookkeeping.wheels import bump_complaints, filter_complaint, hop_frequencies, unsprung_exchanged
from sysid.campaign.findings import QualityReport, RunSpeed, ScanFinding
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.passage.speed import believed_speed
from sysid.campaign.records import Campaign, Scan
from sysid.campaign.requests import beyond_runs
from sysid.errors import DataRejectedError
from sysid.known_results import KnownResults
from sysid.road.road_profile import RoadProfile, ScanAnalysis
from sysid.road.scan import analyse_scan

T = TypeVar("T")


def check_bookkeeping(
    campaign: Campaign,
    read: Campaign,
    analyse: Callable[[Scan], ScanAnalysis] = analyse_scan,
    known: KnownResults | None = None,
) -> QualityReport:
    """Measured speeds, the scans' bumps, and sentences about what contradicts each other.

    Parameters
    ----------
    campaign
        After the quality check: without rejected channels, and without runs of which nothing is left.
    read
        As read, for what the list says of all tests.
    analyse
        Analysis of a scan, for those who know it already.
    known
        What was found in logs before; what is found now is added.

    Returns
    -------
    QualityReport
        Without channels; `left_out` are the scans that cannot be used, `contradictions` what does not fit together.
    """
    known = known or KnownResults()
    passages = {
        run.log.file: known.of(find_passage, run.log.channels, campaign.vehicle, run.nominal_speed_m_s)
        for run in campaign.bump_runs
    }
    speeds = tuple(
        RunSpeed(
            run.log.file, run.load_case, run.nominal_speed_m_s, believed_speed(passages[run.log.file], campaign.vehicle)
        )
        for run in campaign.bump_runs
    )
    scans, refused = _scans(campaign.scans, analyse)
    profiles: dict[str, RoadProfile] = {name: scan.profile for name, scan in scans.items()}
    runs, vehicle = campaign.bump_runs, campaign.vehicle
    said = name_complaints(read)
    said += pressure_complaints(campaign)
    places = place_complaints(runs, passages, vehicle)
    # Sensors are judged at the places that the arrivals show: one wrong place is no fault of a sensor beside it. But a
    # sensor that is late against the others of its axle is no axle elsewhere.
    no_faults: list[SensorFault] = []
    faults = _solved(lambda: sensor_complaints(runs, places.vehicle or vehicle), no_faults)
    if places.axle in {fault.axle for fault in faults if fault.lag_s}:
        places = Places(places.said[:-1], vehicle)
    said += [*places.said, *second_passes(runs, passages), *runs_without_bump(runs, passages)]
    there, misplaced = places.vehicle, []
    if there is not None:
        misplaced = _sentences(lambda: place_of_frame_sensors(runs, there))
        said += [*(fault.said for fault in faults), *misplaced]
    said += _sentences(lambda: filter_complaint(runs, campaign.acquisition.filter))
    said += sampling_complaints(runs, campaign.acquisition.filter)
    said += _sentences(lambda: drive_complaints(campaign))
    declared = declared_values(campaign)
    # All that follows rests on the places of the axles, and the balance of the frames on those of their sensors too.
    unplaced = bool(places.said or misplaced)
    spectra = [] if unplaced else [s for run in runs if (s := run_spectra(run, vehicle)) is not None]
    unclear = any(d.unusual and BALANCED & {n.key for n in d.powers} for d in declared)
    masses = _sentences(lambda: mass_complaints(campaign, spectra, unclear))
    hop_hz = {} if places.said else hop_frequencies(runs, passages, vehicle)
    exchanged = _sentences(lambda: unsprung_exchanged(hop_hz, vehicle))
    measured = measured_values(campaign, {} if exchanged else hop_hz, [] if masses or unclear else spectra)
    said += [*masses, *exchanged, *sentences([*declared, *measured], [MASSES])]
    if not places.said:
        cases = campaign.load_cases
        said += _sentences(lambda: bump_complaints(runs, passages, profiles, vehicle, cases))
        said += _sentences(lambda: drop_complaints(campaign, [] if masses else spectra))
    ahead = [sentence for request in campaign.predictions for sentence in beyond_runs(campaign, request)]
    findings = tuple(_scan_finding(name, campaign.scans[name], scan) for name, scan in scans.items())
    of_scans = [*refused, *(m for s in scans.values() for m in s.messages)]
    if one_sided := one_sided_sentence(campaign, scans):
        of_scans.append(one_sided)
    return QualityReport((), (*of_scans, *said, *ahead), tuple(refused), speeds, findings, contradictions=tuple(said))


def _sentences(compare: Callable[[], Sequence[str] | str | None]) -> list[str]:
    findings = _solved(compare, None)
    return [findings] if isinstance(findings, str) else list(findings or ())


def _solved(compare: Callable[[], T], otherwise: T) -> T:
    """What a comparison says; something else where its equations have no solution, as with readings of no sense."""
    try:
        return compare()
    except np.linalg.LinAlgError:
        return otherwise


def _scans(
    scans: Mapping[str, Scan], analyse: Callable[[Scan], ScanAnalysis]
) -> tuple[dict[str, ScanAnalysis], list[str]]:
    done, refused = {}, []
    for name, scan in scans.items():
        try:
            done[name] = analyse(scan)
        except DataRejectedError as error:
            refused.append(str(error))
    return done, refused


def _scan_finding(name: str, scan: Scan, analysis: ScanAnalysis) -> ScanFinding:
    profile = analysis.profile
    return ScanFinding(
        name=name,
        file=scan.file,
        points=analysis.points,
        height_m=float(profile.height_m.max()),
        length_m=profile.length_m,
        width_m=2.0 * analysis.strip_half_width_m if analysis.scanned else None,
        heading_rad=analysis.heading_rad if analysis.scanned else None,
        declared_heading_rad=scan.heading_rad if analysis.scanned else None,
    )
