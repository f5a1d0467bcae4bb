"""Undeclared bending of frames: the frequencies that are tried, and when bending is accepted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import FrameBending, Vehicle
from sysid.estimation.fit.optimum import Optimum, parameter_sd
from sysid.estimation.fit.part_score import PartCandidate
from sysid.estimation.parameters.parameter_set import bending_names
from sysid.estimation.parameters.undeclared_parts import BendingFrame, ModalMass, UndeclaredParts

#: Frequencies [Hz] at which bending is tried: the runs excite them, and a stiff frame has a higher one. They differ by
#: an eighth: with an error of a quarter of the true frequency, only half of the gain is seen.
TRIED_HZ = (5.0, 5.6, 6.3, 7.1, 8.0, 9.0, 10.0, 11.2, 12.5, 14.0, 16.0, 18.0, 20.0)
#: Frequencies of a loaded frame that are tried, relative to the one that follows from the assumed mass.
TRIED_RATIOS = (0.45, 0.5, 0.56, 0.63, 0.71, 0.8, 0.9, 1.12, 1.25, 1.4, 1.6, 1.8)
#: Prior of the frequency of a frame about which nothing is declared: median [Hz] and spread of the logarithm, 95 % of
#: it from 4 to 20 Hz (an assumption).
FREQUENCY_HZ, FREQUENCY_SD = 9.0, 0.4
DAMPING_RATIO = 0.025
#: Smallest share of the motion of a tried frame that the readings must show for a search to begin there. On simulated
#: trucks whose frames bend it was 0.13 to 0.84 at the best frequency of a coarser choice. On rigid three-axle trucks
#: with friction, a rocker or other tires it was at most 0.23. On a rigid realistic truck it was up to 0.6, but there
#: the expected gain of suspension laws was larger. So this share alone does not decide: the expected gain and the gain
#: of the fit do.
LEAST_AMPLITUDE = 0.1
#: Standard deviation of the frequency over that of its prior below which the data determine it.
_KNOWN = 0.5


def frame_candidates(vehicle: Vehicle) -> tuple[PartCandidate, ...]:
    """Frames that may bend, of bodies that are declared rigid, at every frequency that is tried."""
    rigid = [b for b, body in enumerate(vehicle.bodies) if body.bending is None]
    return tuple(_candidate(vehicle, body, hz) for body in rigid for hz in TRIED_HZ)


def modal_mass_candidates(campaign: Campaign) -> tuple[PartCandidate, ...]:
    """Other frequencies of frames that bend, in all load cases but the first, for which frequencies are declared.

    The distribution of mass along the frame is not known: a load may lower a frequency by much more than assumed.
    """
    bending = [b for b, body in enumerate(campaign.vehicle.bodies) if body.bending is not None]
    return tuple(
        _modal_mass_candidate(campaign.vehicle, ModalMass(b, case, -2.0 * float(np.log(ratio))))
        for b in bending
        for case in list(campaign.load_cases)[1:]
        if case in campaign.load_cases_in_use
        for ratio in TRIED_RATIOS
    )


def _modal_mass_candidate(vehicle: Vehicle, mass: ModalMass) -> PartCandidate:
    parts = UndeclaredParts(modal_masses=(mass,))
    words = f"mass along the frame of '{vehicle.bodies[mass.body].name}' in load case '{mass.load_case}'"
    return PartCandidate(words, parts, parts, 1.0, LEAST_AMPLITUDE, lambda trial: True)


def _candidate(vehicle: Vehicle, body: int, hz: float) -> PartCandidate:
    name = vehicle.bodies[body].name

    def plausible(trial: Optimum) -> bool:
        at = trial.problem.model.parameters.names.index(bending_names(name)[0])
        return bool(parameter_sd(trial)[at] < _KNOWN * FREQUENCY_SD)

    def bending_from(start_hz: float) -> tuple[BendingFrame, ...]:
        unknown = FrameBending(FREQUENCY_HZ, DAMPING_RATIO, frequency_sd=FREQUENCY_SD, start_hz=start_hz)
        return (BendingFrame(body, unknown),)

    def joined(of_load_case: Mapping[str, UndeclaredParts]) -> UndeclaredParts:
        """One frame whose modal masses in further load cases move its frequency to the ones given."""
        (_, first), *others = [(case, parts.frames[0].bending.frequency_hz) for case, parts in of_load_case.items()]
        masses = [ModalMass(body, case, 2.0 * float(np.log(first / other))) for case, other in others if other != first]
        return UndeclaredParts(frames=bending_from(first), modal_masses=tuple(masses))

    return PartCandidate(
        f"bending of the frame of '{name}'",
        UndeclaredParts(frames=(BendingFrame(body, FrameBending(hz, DAMPING_RATIO)),)),
        UndeclaredParts(frames=bending_from(hz)),
        1.0,
        LEAST_AMPLITUDE,
        plausible,
        name,
        joined,
    )
