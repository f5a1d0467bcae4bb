"""One pair simulated by the program's own equations: what the algebra of shared errors does, quickly."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from studies.changes.case import CHANGE, differences
from studies.coverage.shards import Record
from studies.small_campaign import small_campaign

SEED = 20261128
_CAMPAIGN = Path("build/changes/campaign")


@cache
def _planned() -> tuple[Any, Any, Any, Any]:
    """Campaign with blank records, its parameters, profiles and instruments."""
    from sysid.campaign.read import read_campaign
    from sysid.estimation.parameters.campaign_parameters import campaign_parameters
    from sysid.road.point_cloud import read_point_cloud
    from sysid.road.profile_files import bump_from_file
    from sysid.road.scan import analyse_scan
    from sysid.runtime import configure
    from sysid.selftest.readings import as_logged, ordinary_instruments

    configure()
    folder = small_campaign(_CAMPAIGN)
    read = read_campaign(folder, point_cloud_reader=read_point_cloud, profile_reader=bump_from_file)
    profiles = {name: analyse_scan(s).profile for name, s in read.scans.items()}
    planned = as_logged(replace(read, plank_drops=()), profiles)
    return planned, campaign_parameters(planned, None), profiles, ordinary_instruments(planned)


def replicate(number: int, seed: int = SEED) -> Record:
    """What `compare` says of both fits of a pair, beside the truth: a truck from the priors, driven twice.

    Masses and tires of the truck are the same both times; motions, noise, offsets and gains are drawn anew. One damper
    of every second pair changes, down and up in turn.
    """
    from sysid.comparison import compare
    from sysid.errors import SysidError
    from sysid.estimation.fit.least_squares import fit_bump_runs
    from sysid.export import write_result
    from sysid.export.covariance_json import COVARIANCE_FILE, write_covariance
    from sysid.results.contents import Results
    from sysid.selftest.readings import simulated_campaign
    from sysid.selftest.replicates import OPTIONS
    from sysid.selftest.world import draw_world
    from sysid.threads import one_blas_thread

    planned, parameters, profiles, instruments = _planned()
    random = np.random.default_rng([seed, number])
    world = draw_world(planned, parameters, profiles, random, OPTIONS.contact)
    axle = int(random.integers(len(planned.vehicle.axles)))
    factor = 1.0 + (CHANGE if number % 4 == 2 else -CHANGE) if number % 2 == 0 else 1.0
    later = np.array([f"c_{axle + 1}" == name for name in parameters.names]) * np.log(factor)
    worlds = (world, replace(world, log_parameters=world.log_parameters + later))
    record = {"number": number, "physics": "own equations", "axle": axle + 1, "factor": factor}
    with tempfile.TemporaryDirectory() as place:
        folders = [Path(place) / name for name in ("before", "after")]
        for turn, (folder, one) in enumerate(zip(folders, worlds, strict=True)):
            readings = simulated_campaign(planned, one, profiles, instruments, random)
            try:
                with one_blas_thread():
                    fit, _ = fit_bump_runs(readings, parameters, profiles, OPTIONS)
            except SysidError as error:
                return {**record, "failed": str(error), "entries": []}
            results = Results(campaign=planned, fit=fit, provenance={"seed": turn})
            folder.mkdir()
            write_result(results, folder / "result.json")
            write_covariance(results, folder / COVARIANCE_FILE)
        (pair,) = compare(*folders).pairs
        (apart,) = compare(*folders, cancel=False).pairs
    alone = [d.log_sd for d in apart.differences if d.quantity in ("stiffness", "damping")]
    return {**record, "failed": None, **differences(pair, axle + 1, factor), "log_sd_alone": alone}
