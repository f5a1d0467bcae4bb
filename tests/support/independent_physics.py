"""Campaigns of independent trucks by kind of physics, with what was declared a little wrong, and their truth.

    python -m tests.support.independent_physics --vehicle "three axles" --physics worn --seed 1 --output build/worn

writes a campaign folder and truth.json: k by load case [N/m], secant c at 0.5 m/s [N s/m], peak load ratios of the
passes that the campaign asks for, over the declared loads.  Nothing of the package is used, but for the names of kinds.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import jax
import numpy as np
from independent_campaign import write_truck_campaign
from independent_motion import peak_ratios
from independent_truck import LOWBOY, THREE_AXLES, Bending, Elements, IndependentTruck

SPEEDS = {"three axles": (8.0, 16.0, 24.0), "lowboy": (12.0, 20.0, 28.0)}
PASSES = (("empty", 48.0), ("laden", 32.0))
#: Standard deviations of declared unsprung masses, pitch inertias and heights, of a scale, and of its single readings.
UNSPRUNG, INERTIA, HEIGHT, SCALE, READING = 0.03, 0.05, 0.03, 0.005, 0.005
#: Standard deviations of the logarithms of k and c about those of the truck, and of tires about the declared ones.
SPRINGS, TIRE, TIRE_DAMPING = 0.2, 0.03, 0.3
#: Air springs are softer than the leaves in their place, and grow with the carried load to this power.
AIR_SHARE, LOAD_EXPONENT = 0.35, 0.7
CORRELATION = 0.3


@dataclass(frozen=True)
class Physics:
    """How a truck differs from linear springs and dampers; every truck has stops, beyond the range `travel_m`.

    `friction` range of its share of the load carried by leaves; `ratio` of dampers in compression and `knee_m_per_s`;
    `air` springs (a [1/m], b [1/m2]) on drive axles; `rocker` share of the load of a tandem or tridem; `bending_hz` of
    the last body; `reading` standard deviation of a scale's readings; `change` of speed over a passage; `roughness_m3`;
    `spokes` exponent of the tire's spokes; `outliers` share of readings.
    """

    friction: tuple[float, float] = (0.0, 0.0)
    ratio: float = 1.0
    knee_m_per_s: float = 1e9
    air: tuple[float, float] | None = None
    rocker: float = 0.0
    bending_hz: float = 0.0
    travel_m: tuple[float, float] = (0.065, 0.095)
    reading: float = READING
    change: float = 0.0
    roughness_m3: float = 0.0
    spokes: float = 0.7
    outliers: float = 0.0

    @property
    def linear(self) -> bool:
        """Whether springs and dampers are linear and nothing rubs."""
        return not self.friction[1] and self.ratio == 1.0 and self.knee_m_per_s > 1e3 and self.air is None


KINDS = {
    "linear": Physics(),
    "2 % friction": Physics(friction=(0.02, 0.02)),
    "7 % friction": Physics(friction=(0.07, 0.07)),
    "10 % friction": Physics(friction=(0.1, 0.1)),
    "saturating dampers": Physics(knee_m_per_s=0.4),
    "asymmetric dampers": Physics(ratio=0.65),
    "progressive air springs": Physics(air=(2.5, 30.0)),
    "worn": Physics(friction=(0.04, 0.08), ratio=0.6, knee_m_per_s=1.2, air=(2.5, 30.0)),
    "full rocker": Physics(rocker=1.0),
    "half a rocker that rubs": Physics(rocker=0.5, friction=(0.05, 0.05)),
    "short travels": Physics(travel_m=(0.045, 0.06)),
    "frame bends at 7 Hz": Physics(bending_hz=7.0),
    "frame bends at 12 Hz": Physics(bending_hz=12.0),
    "bends and rubs": Physics(bending_hz=9.0, friction=(0.06, 0.06)),
    "axle loads 1 % off": Physics(reading=0.01),
    "speed falls by 5 %": Physics(change=-0.05),
    "rough road": Physics(roughness_m3=1e-6),
    "flat tire law": Physics(spokes=0.5),
    "steep tire law": Physics(spokes=0.95),
    "2 % outliers": Physics(outliers=0.02),
}


def declared_truck(vehicle: str, physics: Physics) -> IndependentTruck:
    """What is declared of a truck of some physics."""
    truck = {"three axles": replace(THREE_AXLES, rocker=(), share=0.0), "lowboy": replace(LOWBOY, bending=())}[vehicle]
    if vehicle == "three axles" and physics.air:
        truck = replace(truck, suspension=("leaf", "air", "air"))
    return truck


def true_truck(
    declared: IndependentTruck, physics: Physics, rng: np.random.Generator, scale_error: float | None = None
) -> IndependentTruck:
    """A truck of some physics, as far from the declared one as such things are.

    `scale_error` is the common error of the scale in its standard deviations, None for a random one.
    """

    def about(values: tuple[float, ...], sd: float) -> np.ndarray:
        return np.array(values) * np.exp(sd * rng.normal(size=len(values)))

    axles = len(declared.x_m)
    air = np.array([s == "air" for s in declared.suspension])
    unsprung = about(declared.unsprung_kg, UNSPRUNG)
    random_error = rng.normal()
    scale = 1.0 + SCALE * (random_error if scale_error is None else scale_error)
    inertia, height = (np.exp(sd * rng.normal(size=declared.bodies)) for sd in (INERTIA, HEIGHT))
    cases = {}
    for name, (loads, sprung, pitch, tall) in declared.load_cases.items():
        true = np.array(loads) * scale * (1.0 + physics.reading * rng.normal(size=axles))
        more = (true - unsprung) - (np.array(loads) - np.array(declared.unsprung_kg))
        carried = np.array(sprung) + np.bincount(declared.body, more, declared.bodies)
        cases[name] = tuple(true), tuple(carried), tuple(np.array(pitch) * inertia), tuple(np.array(tall) * height)
    stiffness = about(declared.stiffness, SPRINGS)
    if declared.bodies == 1:
        stiffness = np.where(air, AIR_SHARE * stiffness, stiffness)
    share = np.where(air, 0.0, rng.uniform(*physics.friction, size=axles))
    travels = rng.uniform(*physics.travel_m, size=(axles, 2))
    elements = tuple(
        Elements(
            friction_share=float(share[i]),
            bump_ratio=physics.ratio,
            rebound_ratio=2.0 - physics.ratio,
            knee_m_per_s=physics.knee_m_per_s,
            air=physics.air if physics.air and air[i] else (0.0, 0.0),
            load_exponent=LOAD_EXPONENT if air[i] else 0.0,
            jounce_m=float(travels[i, 0]),
            rebound_m=float(travels[i, 1]),
            declared=False,
        )
        for i in range(axles)
    )
    last = declared.bodies - 1
    ends = (declared.hitch[-1][0] if declared.hitch else -0.6), declared.x_m[-1] + 0.8
    bending = (None,) * last + (Bending(physics.bending_hz, 0.025, ends),) if physics.bending_hz else ()
    tandem = tuple(i for i in range(axles) if declared.body[i] == last and not air[i] and i > 0)
    return replace(
        declared,
        unsprung_kg=tuple(unsprung),
        load_cases=cases,
        stiffness=tuple(stiffness),
        damping=tuple(about(declared.damping, SPRINGS)),
        tire_N_per_m=tuple(about(declared.tire_N_per_m, TIRE)),
        tire_N_s_per_m=tuple(about(declared.tire_N_s_per_m, TIRE_DAMPING)),
        elements=elements,
        bending=bending,
        rocker=tandem if physics.rocker else (),
        share=physics.rocker,
        roughness_m3=physics.roughness_m3,
        road_seed=int(rng.integers(1 << 30)),
        spoke_exponent=physics.spokes,
    )


def write(folder: Path, vehicle: str, kind: str, seed: int, scale_error: float | None = None) -> None:
    """A campaign folder and its truth."""
    physics, rng = KINDS[kind], np.random.default_rng([seed, 71])
    declared = declared_truck(vehicle, physics)
    truck = true_truck(declared, physics, rng, scale_error)
    write_truck_campaign(
        folder,
        truck,
        speeds=SPEEDS[vehicle],
        changes=(physics.change,),
        load_shift=bool(physics.change),
        predicted=PASSES,
        written=replace(declared, elements=truck.elements),
        correlation=CORRELATION,
        outliers=physics.outliers,
        seed=seed,
    )
    ratios = peak_ratios(truck, PASSES)
    weighed = np.array([np.array(truck.load_cases[c][0]) / np.array(declared.load_cases[c][0]) for c, _ in PASSES])
    truth = {
        "linear": physics.linear,
        "stiffness": {case: truck.stiffness_of(case).tolist() for case in truck.load_cases},
        "damping": truck.secant_damping().tolist(),
        "peaks": (ratios * weighed).tolist(),
    }
    (folder / "truth.json").write_text(json.dumps(truth), encoding="utf-8")


def main() -> None:
    """Write one campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", choices=list(SPEEDS), required=True)
    parser.add_argument("--physics", choices=list(KINDS), required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--scale-error", type=float, help="of the scale, in its standard deviations; random without")
    parser.add_argument("--output", type=Path, required=True)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    write(options.output, options.vehicle, options.physics, options.seed, options.scale_error)


if __name__ == "__main__":
    main()
