"""The same truck by bump runs and by drives: k and c of `calibrate.py fit` beside those of `balance` from drives alone.

    python -m studies.road_drives.pairs [--wrong] [--output DIR] [--count N] [--first N] [--seed S] [--document FILE]

Trucks as in `trucks.py`, by turns with three and with two axles, one load case; three bump runs and two drives each, by
the equations of `tests/support/independent_motion.py`. With `--wrong` they have physics that no law of the package has.
A study that was stopped goes on where it was.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.cases import run_cases
from studies.coverage.shards import Record
from studies.road_drives.pairs_table import tables, write_tables, write_wrong, wrong_tables
from studies.road_drives.trucks import CLASSES, RADIUS_M, SETTLING_S, Truth, draw, road

if TYPE_CHECKING:
    sys.path.insert(0, "tests/support")
    from independent_truck import Elements, IndependentTruck

ROOT = Path(__file__).resolve().parents[2]
SEED = 20261130
SPEEDS_KM_H = (8.0, 16.0, 24.0)
#: Speed [km/h] and class of the road of each drive, and its seconds.
DRIVES, DRIVE_S = ((60.0, "B"), (40.0, "C")), 42.0
#: Trucks that are simulated side by side.
_TOGETHER = 8
#: Length of road that the contact of a tire spans [m].
_CONTACT_M = 0.2
_CASE = "only"
WRONG = ("bushing", "leaf", "helper", "bump")


@dataclass(frozen=True)
class Pair:
    """A truck, what is declared of it, its clean readings in runs and drives, and how these were driven."""

    truck: IndependentTruck
    declared: IndependentTruck
    physics: str
    speeds_m_s: tuple[float, ...]
    readings: tuple[np.ndarray, ...]


def _support() -> None:
    if (folder := str(ROOT / "tests" / "support")) not in sys.path:
        sys.path.insert(0, folder)


def physics_of(number: int, wrong: bool) -> str:
    """Physics of a pair: that of the package, or others in turn."""
    return WRONG[number % len(WRONG)] if wrong else "of the model"


def elements_of(truth: Truth, physics: str) -> tuple[Elements, ...]:
    """Suspensions of all axles, by the drawn laws and what the physics changes of them."""
    _support()
    from independent_truck import Elements

    found = []
    for i, ratio in enumerate(truth.ratio.tolist()):
        one = Elements(
            friction_share=float(truth.friction[i]),
            slip_length_m=truth.slip_m,
            bump_ratio=2.0 / (1.0 + ratio),
            rebound_ratio=2.0 * ratio / (1.0 + ratio),
            knee_m_per_s=float(truth.knee[i]),
            air=(-float(truth.slope[i]), float(truth.curve[i])),
        )
        if physics == "bushing":
            # Two eyes of two dampers.
            one = replace(one, bushing_m_per_N=1.0 / 3e6, knee_m_per_s=1e9)
        elif physics == "leaf" and not truth.air[i]:
            one = replace(one, friction_share=0.08, slip_length_m=6e-3, fading=0.6)
        elif physics == "helper" and i > 0:
            one = replace(one, helper_N_per_m=float(truth.k[i]), helper_m=0.02)
        found.append(one)
    return tuple(found)


def trucks_of(number: int, seed: int, wrong: bool) -> tuple[IndependentTruck, IndependentTruck]:
    """A truck and what its campaign says of it: tolerances as in `trucks.py`."""
    _support()
    from independent_truck import IndependentTruck

    rng = np.random.default_rng([seed, int(wrong), number])
    truth = draw(rng, rear=2 - number // _TOGETHER % 2)
    physics = physics_of(number, wrong)
    if physics == "leaf":
        truth = replace(truth, air=np.zeros_like(truth.air), slope=0.0 * truth.slope, curve=0.0 * truth.curve)

    def off(sd: float, size: int | None = None) -> Any:
        return np.exp(sd * rng.normal(size=size))

    n = truth.x.size
    sprung = float((truth.load_kg - truth.unsprung).sum())
    loads, unsprung = truth.load_kg * off(0.005) * off(0.005, n), truth.unsprung * off(0.03, n)

    def case(load: np.ndarray, carried: float, inertia: float, height: float) -> dict[str, Any]:
        return {_CASE: (tuple(load.tolist()), (float(carried),), (float(inertia),), (float(height),))}

    truck = IndependentTruck(
        body=(0,) * n,
        x_m=tuple(truth.x.tolist()),
        unsprung_kg=tuple(truth.unsprung.tolist()),
        radius_m=(RADIUS_M,) * n,
        tire_N_per_m=tuple(truth.tire_k.tolist()),
        tire_N_s_per_m=tuple(truth.tire_c.tolist()),
        stiffness=tuple(truth.k.tolist()),
        damping=tuple(truth.c.tolist()),
        load_cases=case(truth.load_kg, sprung, truth.inertia, truth.height),
        suspension=tuple("air" if a else "leaf" for a in truth.air),
        elements=elements_of(truth, physics),
    )
    declared = replace(
        truck,
        unsprung_kg=tuple(unsprung.tolist()),
        tire_N_per_m=tuple((truth.tire_k * off(0.05, n)).tolist()),
        tire_N_s_per_m=(2.5e3,) * n,
        load_cases=case(
            loads,
            float(loads.sum() - unsprung.sum()),
            truth.inertia * float(off(0.05)),
            truth.height * float(off(0.03)),
        ),
    )
    return truck, declared


def ground(rng: np.random.Generator, roughness: float, speed: float) -> np.ndarray:
    """Heights of a road as wheels feel it, every 5 cm from 20 m behind station 0, level until there."""
    _support()
    from independent_motion import ROAD_BEGIN_M, ROAD_STEP_M

    station, heights = road(rng, roughness, DRIVE_S * 1.02 * 60.0 / 3.6 + 60.0)
    width = round(_CONTACT_M / ROAD_STEP_M)
    felt = np.convolve(heights, np.full(width, 1.0 / width), "same")
    return np.asarray(felt * np.clip((station + ROAD_BEGIN_M) / (speed * SETTLING_S), 0.0, 1.0))


@lru_cache(maxsize=1)
def simulated(first: int, seed: int, wrong: bool) -> list[Pair]:
    """Pairs whose trucks have as many axles, side by side."""
    _support()
    from independent_motion import INTERVAL_S, LENGTH_M, simulate

    from sysid.runtime import configure

    configure()
    made = [trucks_of(first + k, seed, wrong) for k in range(_TOGETHER)]
    rng = np.random.default_rng([seed, int(wrong), first, 7])
    trucks = [truck for truck, _ in made]
    told = np.tile(SPEEDS_KM_H, (len(trucks), 1)) / 3.6
    bump = told * (1.0 + 0.01 * rng.normal(size=told.shape))
    every = [t for t in trucks for _ in SPEEDS_KM_H]
    runs = [(_CASE, float(v), 1.0, 0.0) for v in bump.ravel()]
    last = max(t.x_m[-1] for t in trucks)
    seconds = 1.0 + (last + LENGTH_M) / bump.min() + 2.0
    over = simulate(every, runs, seconds, step_s=1e-3)
    road_speeds = (
        np.array([v for v, _ in DRIVES]) / 3.6 * np.exp(rng.uniform(-0.015, 0.015, (len(trucks), len(DRIVES))))
    )
    on = simulate(
        [t for t in trucks for _ in DRIVES],
        [(_CASE, float(v), 0.0, 0.0) for v in road_speeds.ravel()],
        DRIVE_S,
        roads=np.array(
            [ground(rng, CLASSES[name], v) for row in road_speeds for v, (_, name) in zip(row, DRIVES, strict=True)]
        ),
        step_s=1e-3,
    )
    found = []
    for k, (truck, declared) in enumerate(made):
        readings = []
        for j, v in enumerate(bump[k]):
            count = int((1.0 + (truck.x_m[-1] + LENGTH_M) / v + 2.0) / INTERVAL_S)
            readings.append(over[:count, len(SPEEDS_KM_H) * k + j])
        readings += [on[int(SETTLING_S / INTERVAL_S) :, len(DRIVES) * k + j] for j in range(len(DRIVES))]
        speeds = (*bump[k].tolist(), *road_speeds[k].tolist())
        found.append(Pair(truck, declared, physics_of(first + k, wrong), speeds, tuple(readings)))
    return found


def write_pair(folder: Path, pair: Pair, rng: np.random.Generator) -> None:
    """Campaign files of the whole and of the drives alone, with logs and a scan."""
    _support()
    from campaign_files import sensor_columns, write_log, write_scan
    from independent_campaign import NOISE, campaign_text, noise_of
    from independent_motion import INTERVAL_S, LENGTH_M, height

    folder.mkdir(parents=True)
    # A bump that gives by 8 % under the wheels is higher where nothing presses it.
    scanned = 1.0 / 0.92 if pair.physics == "bump" else 1.0

    def profile(s: np.ndarray) -> np.ndarray:
        return scanned * np.asarray(height(s))

    write_scan(folder / "bump_scan.csv", profile, 0.5 * LENGTH_M, 20_000, 0.0015, rng)
    columns, kinds = sensor_columns(len(pair.truck.x_m))
    sd = np.array([NOISE[k] for k in kinds])
    gain = 1.0 + np.array([{"lvdt": 0.005, "axle": 0.01, "frame": 0.01}[k] for k in kinds]) * rng.normal(size=sd.size)
    runs: list[str] = []
    drives: list[str] = []
    names = [f"bump {v:g}" for v in SPEEDS_KM_H] + [f"drive {v:g}" for v, _ in DRIVES]
    for name, values in zip(names, pair.readings, strict=True):
        kind, told = name.split()
        shown = gain * values[:, : sd.size]
        shown = shown + sd * (noise_of(rng, shown.shape, 0.0, 0.0) + 4.0 * rng.uniform(-1.0, 1.0, sd.size))
        file = name.replace(" ", "_") + ".csv"
        write_log(folder / file, INTERVAL_S, columns, kinds, shown)
        label = f'case = "{name}", ' if kind == "bump" else ""
        entry = f'  {{ {label}file = "{file}", load_case = "{_CASE}", nominal_speed_km_h = {told} }},'
        (runs if kind == "bump" else drives).append(entry)
    for name, of_bump in (("whole.toml", runs), ("drives.toml", [])):
        text = campaign_text(pair.declared, "", "", of_bump, [], drives)
        (folder / name).write_text(text, encoding="utf-8")


def replicate(number: int, seed: int = SEED, wrong: bool = False) -> Record:
    """k and c of one truck by the bump and by drives, beside the truth, and what the verdict says."""
    pair = simulated(number - number % _TOGETHER, seed, wrong)[number % _TOGETHER]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "campaign"
        write_pair(folder, pair, np.random.default_rng([seed, int(wrong), number, 3]))
        return {"number": number, "physics": pair.physics, **by_both(folder, Path(place), pair.truck)}


def by_both(folder: Path, place: Path, truck: IndependentTruck) -> Record:
    """The user's commands on the campaign files in a folder, and what they find."""
    codes = []
    for stages, name in ((("fit", "balance"), "whole"), (("balance",), "drives")):
        for stage in stages:
            command = [sys.executable, "calibrate.py", stage, str(folder / f"{name}.toml")]
            command += ["--output", str(place / name)]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            codes.append(done.returncode)
            if done.returncode not in (0, 4):
                return {"failed": f"{stage} {name}: {(done.stderr + done.stdout)[-1500:]}", "entries": []}
    whole, drives = (json.loads((place / n / "result.json").read_text(encoding="utf-8")) for n in ("whole", "drives"))
    beside = {e["name"]: e for e in drives["balance"]["estimates"]}
    joint = {e["name"]: e for e in whole["balance"]["estimates"]}
    true = {"stiffness": truck.stiffness, "damping": truck.secant_damping().tolist()}
    entries = []
    for p in whole["parameters"]:
        if p["name"] in beside and p["quantity"] in true:
            found = p["least_squares"]
            entries.append(
                {
                    "name": p["name"],
                    "quantity": p["quantity"],
                    "truth": float(true[p["quantity"]][p["axle"] - 1]),
                    "bump": [found["value"], found["sd"] / found["value"]],
                    "drives": _of(beside[p["name"]]),
                    "both": _of(joint[p["name"]]),
                    "law": p["law"],
                }
            )
    verdict = whole["verdict"]
    return {
        "failed": None,
        "entries": entries,
        "trust": verdict["trust"],
        "kinds": verdict["kinds"],
        "reasons": verdict["reasons"],
        "codes": codes,
        "said": drives["balance"]["messages"],
    }


def _of(e: dict[str, Any]) -> list[float]:
    return [e["value"], float(np.log(e["q95"] / e["q05"]) / 2.0 / 1.6449)]


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    given = sys.argv[1:] if arguments is None else arguments
    rest = [word for word in given if word != "--wrong"]
    if "--wrong" in given:
        of = "wrong", _replicate_wrong, wrong_tables, write_wrong
    else:
        of = "pair", replicate, tables, write_tables
    run_cases(__doc__, *of, rest, folder="build/pairs", count=4 * len(WRONG) if "--wrong" in given else 40, seed=SEED)


def _replicate_wrong(number: int, seed: int = SEED) -> Record:
    return replicate(number, seed, wrong=True)


if __name__ == "__main__":
    main()
