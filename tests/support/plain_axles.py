"""Axles of which only place and mass matter, for tests of statics and of matrices."""

from __future__ import annotations

from sysid.campaign.vehicle_records import Axle


def axle(name: str, body: int, x_m: float, mass: float = 500.0) -> Axle:
    """An axle of `mass` [kg] below a body; the tires are those of an ordinary truck."""
    return Axle(name, body, x_m, mass, 2.8e6, 3000.0, 0.5, "leaf")
