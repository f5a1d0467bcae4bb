"""Parts of a vehicle that its campaign file does not declare and a fit has added: rockers, frames, the drive."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import DrivenAt, Equaliser, FrameBending, FrameMass, Vehicle
from sysid.display import Z90
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.parameters.parameter_set import bending_names


@dataclass(frozen=True)
class BendingFrame:
    """Bending of the frame of body number `body`."""

    body: int
    bending: FrameBending


@dataclass(frozen=True)
class ModalMass:
    """Logarithm of the modal mass of the frame of body number `body` in a load case, over that of the mass assumed."""

    body: int
    load_case: str
    log_factor: float


@dataclass(frozen=True)
class Drive:
    """What holds the speed: where its force acts, and its time constant [s]."""

    at: DrivenAt
    hold_s: float

    @property
    def proposal(self) -> str:
        """The sentence that asks to declare it."""
        where = "its wheels on the road" if self.at == "road" else "a force at its centre of gravity"
        return (
            f"The truck behaves as if its speed was held by {where}: all results include this. If so, declare "
            f'driven_at = "{self.at}" in [vehicle].'
        )


@dataclass(frozen=True)
class UndeclaredParts:
    """`rockers` between springs, `frames` that bend, their `modal_masses` where not as assumed, and the `drive`.

    True where there is any; sums hold the parts of both, and the later drive.
    """

    rockers: tuple[Equaliser, ...] = ()
    frames: tuple[BendingFrame, ...] = ()
    modal_masses: tuple[ModalMass, ...] = ()
    drive: Drive | None = None

    def __bool__(self) -> bool:
        return bool(self.rockers or self.frames or self.modal_masses or self.drive)

    def __add__(self, other: UndeclaredParts) -> UndeclaredParts:
        return UndeclaredParts(
            self.rockers + other.rockers,
            self.frames + other.frames,
            self.modal_masses + other.modal_masses,
            other.drive or self.drive,
        )

    def on(self, vehicle: Vehicle) -> Vehicle:
        """A vehicle with these parts."""
        bodies = list(vehicle.bodies)
        for frame in self.frames:
            bodies[frame.body] = replace(bodies[frame.body], bending=frame.bending)
        if self.drive is not None:
            vehicle = replace(vehicle, driven_at=self.drive.at, hold_s=self.drive.hold_s)
        return replace(vehicle, bodies=tuple(bodies), equalisers=(*vehicle.equalisers, *self.rockers))

    def in_campaign(self, campaign: Campaign) -> Campaign:
        """A campaign of the vehicle with these parts."""
        if not self:
            return campaign
        cases = dict(campaign.load_cases)
        for part in self.modal_masses:
            case = cases[part.load_case]
            masses = list(case.frame_masses or (FrameMass(),) * len(campaign.vehicle.bodies))
            of_body = masses[part.body]
            masses[part.body] = replace(of_body, log_modal_mass=of_body.log_modal_mass + part.log_factor)
            cases[part.load_case] = replace(case, frame_masses=tuple(masses))
        return replace(campaign, vehicle=self.on(campaign.vehicle), load_cases=cases)


NO_PARTS = UndeclaredParts()


@dataclass(frozen=True)
class UndeclaredFrame:
    """A frame that was declared rigid and bends: `frequency_hz` by itself, with its 90 % interval `low` to `high`."""

    body: str
    frequency_hz: float
    low: float
    high: float

    @property
    def proposal(self) -> str:
        """The sentence that asks to declare it."""
        hz = self.frequency_hz
        return (
            f"The frame of '{self.body}' behaves as if it bends at {hz:.2f} Hz (90 % interval {self.low:.2f} to "
            f"{self.high:.2f} Hz): all results include this. If the frame bends, declare it in its [[vehicle.body]], "
            f"bending = {{ frequency_hz = {hz:.2f} }}; if it is stiff, do not use the results of its axles."
        )


def undeclared_frames(
    vehicle: Vehicle, parts: UndeclaredParts, estimates: Iterable[ParameterEstimate]
) -> tuple[UndeclaredFrame, ...]:
    """The frames among added parts, as estimated: frequencies [Hz] are lognormal about their estimates."""
    by_name = {e.name: e for e in estimates}
    frames = []
    for frame in parts.frames:
        body = vehicle.bodies[frame.body].name
        e = by_name[bending_names(body)[0]]
        spread = float(np.exp(Z90 * e.sd / e.value))
        frames.append(UndeclaredFrame(body, e.value, e.value / spread, e.value * spread))
    return tuple(frames)
