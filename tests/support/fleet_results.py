"""Folders of results of a small fleet, written without any calibration: four trucks, two campaigns each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from small_results import small_results

from sysid.export import result_document
from sysid.fleet.draws import RECORD_FILE, CampaignDraws, write_draws
from sysid.fleet.key import result_digest
from sysid.fleet.outcome import RESULT_FILE, Outcome, write_outcome
from sysid.fleet.running import campaign_output

NAMES = ("k_1", "k_2", "c_1", "c_2", "kt_1")
QUANTITIES = ("stiffness", "stiffness", "damping", "damping", "tire_stiffness")
MEAN = np.log([4e5, 8e5, 9e3, 1.2e4, 2e6])
#: Half of the damping is gone.
BROKEN = ("T3", "c_2", 0.5)


def write_fleet_results(
    root: Path, trucks: int = 6, title: str = "Small fleet", prefix: str = "T"
) -> tuple[Path, Path]:
    """A fleet file and the results of its campaigns: their paths."""
    folder, output = root / "fleet", root / "out"
    random = np.random.default_rng(11)
    lines = ["schema = 1", "[fleet]", f"title = {json.dumps(title, ensure_ascii=False)}"]
    document = result_document(small_results())
    for t in range(trucks):
        name = f"{prefix}{t + 1}"
        lines += ["[[truck]]", f"name = {json.dumps(name, ensure_ascii=False)}", 'type = "short truck"', "campaign = ["]
        truck = MEAN + np.array([0.05, 0.05, 0.08, 0.08, 0.02]) * random.standard_normal(5)
        truck[3] += np.log(BROKEN[2]) if t == 2 else 0.0
        for c in range(2):
            campaign = f"T{t + 1}-{c + 1}"
            lines.append(f'  {{ name = "{campaign}", folder = "{campaign}", date = 2026-0{c + 4}-01 }},')
            _write(output, campaign, document, truck, random)
        lines.append("]")
    folder.mkdir(parents=True)
    (folder / "fleet.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder, output


def _write(output: Path, campaign: str, document: dict, truck: np.ndarray, random: np.random.Generator) -> None:
    place = campaign_output(output, campaign)
    place.mkdir(parents=True)
    prior = np.diag([0.4, 0.4, 0.7, 0.7, 0.1]) ** 2
    width = np.array([0.02, 0.02, 0.04, 0.04, 0.08])
    value = truck + width * random.standard_normal(5)
    posterior = np.linalg.inv(np.linalg.inv(prior) + np.diag(width**-2.0))
    centre = posterior @ (np.linalg.solve(prior, MEAN) + value / width**2)
    draws = random.multivariate_normal(centre, posterior, 1000)
    units = ("N/m", "N/m", "N s/m", "N s/m", "N/m")
    record = CampaignDraws(
        NAMES, QUANTITIES, units, (0, 1, 0, 1, 0), ("",) * 5, ("linear",) * 5, draws, MEAN.copy(), prior
    )
    write_draws(place / RECORD_FILE, record)
    (place / RESULT_FILE).write_text(json.dumps(document), encoding="utf-8")
    digest = result_digest(place / RESULT_FILE)
    write_outcome(
        place, Outcome("done", status="converged", result_sha256=digest, seconds=12.0, peak_bytes=900_000_000)
    )
