"""Settings of the plank-drop analysis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DropSettings:
    """Assumptions of the plank-drop analysis.

    `frequency_range_hz` is where the body mode of a heavy vehicle is sought. The tolerances are relative standard
    deviations of values that the campaign file declares and that are not measured. They enter the standard deviations
    of the estimates. Tire data books scatter by some 5 % in stiffness and 30 % in damping; masses of an axle and of the
    bodywork above it are known to a few per cent (engineering judgement, not from a standard).
    """

    frequency_range_hz: tuple[float, float] = (0.6, 6.0)
    tire_stiffness_tolerance: float = 0.05
    tire_damping_tolerance: float = 0.30
    unsprung_mass_tolerance: float = 0.05
    tributary_mass_tolerance: float = 0.02
