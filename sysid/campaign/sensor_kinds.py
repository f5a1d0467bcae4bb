"""Kinds of sensors, and what each measures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from sysid.campaign.units import Dimension

DeclaredKind = Literal[
    "suspension_deflection", "axle_acceleration", "body_acceleration", "pitch_rate", "speed", "air_pressure"
]
#: Also what follows from a reading: the extension of a bellows, from its pressure.
SensorKind = Literal[DeclaredKind, "bellows_extension"]
#: What each kind measures, and the SI unit of its values in memory.
KIND_DIMENSION: Mapping[SensorKind, Dimension] = {
    "suspension_deflection": "length",
    "axle_acceleration": "acceleration",
    "body_acceleration": "acceleration",
    "pitch_rate": "angular rate",
    "speed": "speed",
    "air_pressure": "pressure",
    "bellows_extension": "length",
}
#: The SI unit of each quantity.
SI_UNITS: Mapping[Dimension, str] = {
    "length": "m",
    "acceleration": "m/s^2",
    "angular rate": "rad/s",
    "speed": "m/s",
    "pressure": "Pa",
}
#: Kinds whose readings may be slower than those of the others. Pitch rates that are not count as vibration.
AUXILIARY_KINDS: frozenset[SensorKind] = frozenset({"pitch_rate", "speed", "air_pressure"})
