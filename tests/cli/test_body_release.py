"""A half car with dry friction, lifted and let go, through the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from half_car import HalfCar, let_go, write_campaign

from sysid.campaign import read_campaign

ROOT = Path(__file__).parents[2]
CAR = HalfCar()


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return write_campaign(tmp_path_factory.mktemp("half_car"), CAR)


def test_friction_of_the_simulated_half_car_holds_it():
    """Let go within the friction, the body stays; let go above, it comes to rest within F/k of the level."""
    inside = 0.5 * min(f / k for f, k in zip(CAR.friction, CAR.stiffness, strict=True))
    assert np.ptp(let_go(CAR, (inside, inside), 0.5, 0.005), axis=0).max() < 2e-5
    rest = let_go(CAR, (0.05, 0.05), 4.0, 0.005)[-1]
    assert all(abs(r) < 1.05 * f / k for r, f, k in zip(rest, CAR.friction, CAR.stiffness, strict=True))


def test_every_measured_axle_of_a_lifted_body_is_a_drop(campaign):
    drops = read_campaign(campaign).plank_drops
    assert [(d.axle, d.lifted) for d in drops[:3]] == [(0, (0, 1)), (1, (0, 1)), (1, (1,))]
    assert all(d.release == "body" and d.plank_height_m is None for d in drops)
    assert [[c.sensor.column for c in d.log.channels] for d in drops[:2]] == [["front_mm"], ["rear_mm"]]


def test_drops_of_the_half_car(campaign, tmp_path):
    command = [sys.executable, "calibrate.py", "drops", str(campaign), "--output", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "show dry friction of" in " ".join(done.stdout.split())
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    pooled = {(d["axle"], d["method"]): d for d in result["drops"] if d["file"] is None}
    for axle in (1, 2):
        found = pooled[axle, "free_decay"]
        assert found["damping_kind"] == "viscous + friction"
        assert found["stiffness"] == pytest.approx(CAR.stiffness[axle - 1], rel=0.05)
        assert pooled[axle, "corrected"]["stiffness"] == pytest.approx(CAR.stiffness[axle - 1], rel=0.03)
        assert found["friction_force"] == pytest.approx(CAR.friction[axle - 1], rel=0.05)
        assert found["damping"] == pytest.approx(CAR.damping[axle - 1], rel=0.15)
        # Periods and decrements alone take the friction for damping; their rows say so.
        assert pooled[axle, "corrected"]["friction_force"] is None
        assert "against the fitted quarter car" in pooled[axle, "corrected"]["note"]
        # The dynamic index is close to one: each end swings by itself, at a period between those of the two modes.
        shortest, longest = body_periods()
        assert 0.99 * shortest < found["damped_period"] < 1.01 * longest


def body_periods() -> tuple[float, float]:
    """Damped periods [s] of heave and pitch of the half car without friction, from its own matrices."""
    to_body = np.stack([np.ones(2), np.array([CAR.front_m, -CAR.rear_m])])
    k, c, tire = (np.array(v) for v in (CAR.stiffness, CAR.damping, CAR.tire))
    rows = np.concatenate([to_body.T, -np.eye(2)], axis=1)
    mass = np.diag([CAR.mass, CAR.inertia, *CAR.unsprung])
    stiffness = rows.T @ np.diag(k) @ rows + np.diag([0.0, 0.0, *tire])
    damping = rows.T @ np.diag(c) @ rows
    state = np.block(
        [[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
    )
    rates = np.sort([s.imag for s in np.linalg.eigvals(state) if s.imag > 0.0])
    return 2.0 * np.pi / rates[1], 2.0 * np.pi / rates[0]
