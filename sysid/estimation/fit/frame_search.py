"""Frames that nobody declared to bend: at which frequencies one is tried, and when it is believed."""

from __future__ import annotations

from sysid.campaign.vehicle_records import FrameBending, Vehicle
from sysid.estimation.fit.evaluation import parameter_sd
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.part_score import PartCandidate
from sysid.estimation.parameters.parameter_set import bending_names
from sysid.estimation.parameters.undeclared_parts import BendingFrame, UndeclaredParts

#: Frequencies [Hz] at which bending is tried: those that the runs excite and a stiff frame lies above.  Steps of an
#: eighth: a step of a quarter beside the true frequency shows half of what it explains.
TRIED_HZ = (5.0, 5.6, 6.3, 7.1, 8.0, 9.0, 10.0, 11.2, 12.5, 14.0, 16.0, 18.0, 20.0)
#: Prior of the frequency of a frame of which nobody has said anything: median [Hz] and spread of the logarithm, 95 % of
#: it from 4 to 20 Hz (an assumption).
FREQUENCY_HZ, FREQUENCY_SD = 9.0, 0.4
DAMPING_RATIO = 0.025
#: Least share of the motion of a tried frame that the readings have to show, for a search to begin from there.  On
#: simulated trucks whose frames bend it was 0.13 to 0.84 at the best frequency of a coarser choice; on rigid ones of
#: three axles that rub, have a rocker or roll on other tires it was at most 0.23.  On a rigid realistic truck it was up
#: to 0.6, but suspension laws promised more: what is promised and what the fit gains decide.
LEAST_AMPLITUDE = 0.1
#: Standard deviation of the frequency over that of its prior below which the data determine it.
_KNOWN = 0.5


def frame_candidates(vehicle: Vehicle) -> tuple[PartCandidate, ...]:
    """Frames that may bend, of bodies that are declared rigid, at every frequency that is tried."""
    rigid = [b for b, body in enumerate(vehicle.bodies) if body.bending is None]
    return tuple(_candidate(vehicle, body, hz) for body in rigid for hz in TRIED_HZ)


def _candidate(vehicle: Vehicle, body: int, hz: float) -> PartCandidate:
    name = vehicle.bodies[body].name

    def plausible(trial: Optimum) -> bool:
        at = trial.problem.model.parameters.names.index(bending_names(name)[0])
        return bool(parameter_sd(trial)[at] < _KNOWN * FREQUENCY_SD)

    def frame(bending: FrameBending) -> UndeclaredParts:
        return UndeclaredParts(frames=(BendingFrame(body, bending),))

    unknown = FrameBending(FREQUENCY_HZ, DAMPING_RATIO, frequency_sd=FREQUENCY_SD, start_hz=hz)
    return PartCandidate(
        f"bending of the frame of '{name}'",
        frame(FrameBending(hz, DAMPING_RATIO)),
        frame(unknown),
        1.0,
        LEAST_AMPLITUDE,
        plausible,
    )
