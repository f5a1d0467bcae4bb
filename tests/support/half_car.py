"""A half car on two axles with dry friction, lifted and let go: its own equations of motion, and a campaign of it.

Body heave and pitch, two axles on linear tires, suspensions k, c with Coulomb friction F.  Friction is exact: in every
step of 0.1 ms the friction forces are those between -F and F that stop the sliding, if any can (velocity-level
complementarity, solved by projected Gauss-Seidel; Moreau 1988, doi:10.1007/978-3-7091-2624-0_1).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

STEP_S = 1e-4


@dataclass(frozen=True)
class HalfCar:
    """Body mass [kg], pitch inertia [kg m2], distances [m] of the axles from the centre of gravity, and per axle."""

    mass: float = 7000.0
    inertia: float = 7000.0 * 2.1 * 2.3 * 1.02
    front_m: float = 2.1
    rear_m: float = 2.3
    unsprung: tuple[float, float] = (520.0, 900.0)
    tire: tuple[float, float] = (1.7e6, 2.9e6)
    stiffness: tuple[float, float] = (3.2e5, 3.6e5)
    damping: tuple[float, float] = (3.0e3, 2.5e3)
    friction: tuple[float, float] = (9.0e2, 1.1e3)

    @property
    def body_loads(self) -> tuple[float, float]:
        """Part of the body mass [kg] above each axle."""
        wheelbase = self.front_m + self.rear_m
        return self.mass * self.rear_m / wheelbase, self.mass * self.front_m / wheelbase


def let_go(car: HalfCar, lift_m: tuple[float, float], duration_s: float, interval_s: float) -> np.ndarray:
    """Suspension deflections (n, 2) [m] after the body was held `lift_m` above its rest at the two axles."""
    arms = np.array([car.front_m, -car.rear_m])
    to_body = np.stack([np.ones(2), arms])  # body forces from suspension forces; its transpose gives body motion
    body_mass = np.array([car.mass, car.inertia])
    unsprung, tire = np.array(car.unsprung), np.array(car.tire)
    k, c, limit = np.array(car.stiffness), np.array(car.damping), np.array(car.friction)
    body = np.linalg.solve(to_body.T, np.array(lift_m))
    # Held by the crane, with the axles pulled up by the springs.
    wheel = k * np.array(lift_m) / (k + tire)
    body_rate, wheel_rate = np.zeros(2), np.zeros(2)
    compliance = (to_body.T / body_mass) @ to_body + np.diag(1.0 / unsprung)
    impulse, record = np.zeros(2), []
    every = round(interval_s / STEP_S)
    for step in range(round(duration_s / STEP_S)):
        deflection = to_body.T @ body - wheel
        if step % every == 0:
            record.append(deflection)
        force = k * deflection + c * (to_body.T @ body_rate - wheel_rate)
        body_rate = body_rate - STEP_S * (to_body @ force) / body_mass
        wheel_rate = wheel_rate + STEP_S * (force - tire * wheel) / unsprung
        sliding = to_body.T @ body_rate - wheel_rate
        for _ in range(4):
            for i in range(2):
                now = sliding[i] - compliance[i] @ impulse
                wanted = impulse[i] + now / compliance[i, i]
                impulse[i] = min(max(wanted, -limit[i] * STEP_S), limit[i] * STEP_S)
        body_rate = body_rate - (to_body @ impulse) / body_mass
        wheel_rate = wheel_rate + impulse / unsprung
        body, wheel = body + STEP_S * body_rate, wheel + STEP_S * wheel_rate
    return np.array(record)


def write_campaign(folder: Path, car: HalfCar, repeats: int = 2, seed: int = 1, lift_m: float = 0.05) -> Path:
    """Campaign file and logs of a body lifted above both axles and let go, and above the rear axle alone."""
    random = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for repeat in range(1, repeats + 1):
        for name, lift, axles in (
            ("both", (lift_m, lift_m), 'axles = ["front", "rear"]'),
            ("rear", (0.0, lift_m), 'axle = "rear"'),
        ):
            scaled = (lift[0] * random.uniform(0.9, 1.1), lift[1] * random.uniform(0.9, 1.1))
            free = let_go(car, scaled, 4.0, 0.005)
            value = np.concatenate([np.tile(free[0], (120, 1)), free])
            value = 1e3 * value + 0.25 * random.standard_normal(value.shape) + random.uniform(-3.0, 3.0, 2)
            file = f"{name}_{repeat}.csv"
            lines = [f"{0.005 * i:.3f},{a:.3f},{b:.3f}" for i, (a, b) in enumerate(value)]
            (folder / file).write_text("time_s,front_mm,rear_mm\n" + "\n".join(lines) + "\n", encoding="utf-8")
            entries.append(f'  {{ {axles}, release = "body", file = "{file}" }},')
    (folder / "campaign.toml").write_text(_campaign_text(car, entries), encoding="utf-8")
    return folder / "campaign.toml"


def _campaign_text(car: HalfCar, entries: list[str]) -> str:
    loads = [m + u for m, u in zip(car.body_loads, car.unsprung, strict=True)]
    axles = "".join(
        f'[[vehicle.axle]]\nname = "{name}"\nbody = "body"\nx_m = {x}\nunsprung_mass_kg = {car.unsprung[i]}\n'
        f"tire_stiffness_N_per_m = {car.tire[i]}\ntire_damping_N_s_per_m = 0.0\ntire_radius_m = 0.5\n"
        'suspension = "leaf"\n\n'
        for i, (name, x) in enumerate((("front", 0.0), ("rear", car.front_m + car.rear_m)))
    )
    return (
        'schema = 1\n\n[campaign]\ntitle = "Half car let go"\n\n[vehicle]\nname = "half car"\n\n'
        f'[[vehicle.body]]\nname = "body"\n\n{axles}'
        f"[load_case.empty]\naxle_loads_kg = [{loads[0]:.3f}, {loads[1]:.3f}]\nsprung_mass_kg = [{car.mass}]\n"
        f"pitch_inertia_kg_m2 = [{car.inertia}]\ncg_height_m = [1.1]\n\n"
        "[acquisition]\nsample_interval_s = 0.005\n\n[sensors.plank_drop]\n"
        'front_mm = { kind = "suspension_deflection", unit = "mm", axle = "front" }\n'
        'rear_mm = { kind = "suspension_deflection", unit = "mm", axle = "rear" }\n\n'
        "[tests]\nplank_drop = [\n" + "\n".join(entries) + "\n]\n"
    )
