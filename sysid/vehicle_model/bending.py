"""Frames that bend: one free-free bending mode per body, its shape and its modal mass.

The mode's amplitude eta is a coordinate beside the body's heave and pitch: a point at x rises by phi(x) eta more.  The
shape begins as that of a free uniform beam between the body's first and last support or hinge,

    psi(t) = cosh b t + cos b t - r (sinh b t + sin b t),  t = (x - x_first) / L,  cos b cosh b = 1,  b = 4.7300,
    r = (cosh b - cos b) / (sinh b - sin b),  mean square 1, 2 at both ends

(R. D. Blevins, Formulas for natural frequency and mode shape, 1979, table 8-1), or as the declared one. The
distribution of the body's mass along the same length must have its mass m, centre of gravity and pitch inertia I. It is
assumed to be that of a uniform beam with a point mass at each end. If one of these would be negative, because the mass
lies nearer to the middle, it is the density of largest entropy mu(x) = exp(a + b x + c x^2) (E. T. Jaynes, Information
theory and statistical mechanics, Physical Review 106 (1957), doi:10.1103/PhysRev.106.620). Heave, pitch and modal mass
jump where one distribution takes the place of the other. So masses that a fit moves keep the kind that the declared
ones have, with an end that may lack some mass. Heave and pitch are removed from the shape, so that the mode has no
momentum and is orthogonal to both,

    phi = psi - int mu psi / m - (x - x_cg) int mu psi (x - x_cg) / I,    modal mass int mu phi^2.

Only the frame bends, so its modal stiffness is the same in all load cases: (2 pi f)^2 times the modal mass in the first
one, to which the declared frequency f belongs. The slope of the bent frame does not move wheels fore and aft.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from sysid.campaign.statics import static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import CampaignError

#: First root of cos b cosh b = 1 beyond zero.
FREE_BEAM_ROOT = 4.730040744862704
#: Share of the mass that a frame's end may lack while masses are moved.
_MOST_LACKING = 0.1
#: Quadrature of Gauss and Legendre over the length of a frame.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(80)


@dataclass(frozen=True)
class FrameMode:
    """Bending mode of one body in one load case.

    - `body`: index;
    - `rise` gives phi at positions x [m];
    - `modal_mass` [kg] in this load case and `stiffness_mass` [kg] in the one that the frequency is declared for: the
      force that straightens the frame is -`stiffness_mass` (omega^2 eta + 2 zeta omega eta').
    """

    body: int
    rise: Callable[[float], float]
    modal_mass: float
    stiffness_mass: float


def free_beam(t: np.ndarray) -> np.ndarray:
    """First bending mode psi of a free uniform beam at t in [0, 1] of its length, mean square 1."""
    b = FREE_BEAM_ROOT
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    return np.asarray(np.cosh(b * t) + np.cos(b * t) - ratio * (np.sinh(b * t) + np.sin(b * t)))


def frame_modes(vehicle: Vehicle, load_case: LoadCase, first: LoadCase | None = None) -> tuple[FrameMode, ...]:
    """Bending modes of all bodies that bend, front to rear.

    Parameters
    ----------
    first : the load case that frequencies are declared for; None: `load_case`.

    Raises
    ------
    CampaignError
        If no mass along the body's length has its centre of gravity and pitch inertia.
    """
    modes = []
    for b, body in enumerate(vehicle.bodies):
        if body.bending is None:
            continue
        rise, mass = _shape(vehicle, b, load_case)
        stiffness_mass = mass if first is None or first is load_case else _shape(vehicle, b, first)[1]
        modes.append(FrameMode(b, rise, mass, stiffness_mass))
    return tuple(modes)


def frame_ends(vehicle: Vehicle, body: int) -> tuple[float, float]:
    """Positions [m] of a body's first and last support or hinge."""
    at = [x for x, a in zip(vehicle.suspension_x_m, vehicle.axles, strict=True) if a.body == body]
    at += [a.x_m for a in vehicle.axles if a.body == body]
    at += [b.hitch_x_m for b in vehicle.bodies[body : body + 2] if b.hitch_x_m is not None]
    return min(at), max(at)


@dataclass(frozen=True)
class _Frame:
    """A frame that bends: its ends `low` and `high` and its centre of gravity [m], mass [kg] and inertia [kg m^2]."""

    low: float
    high: float
    cg_x: float
    mass: float
    inertia: float

    @property
    def half(self) -> float:
        """Half of its length [m]."""
        return 0.5 * (self.high - self.low)

    @property
    def middle(self) -> float:
        """Position of its middle [m]."""
        return 0.5 * (self.high + self.low)

    @property
    def moments(self) -> tuple[float, float]:
        """Mean of the mass along the frame, whose ends are at -1 and 1, and the variance about it."""
        return (self.cg_x - self.middle) / self.half, self.inertia / self.mass / self.half**2


def _frame(vehicle: Vehicle, body: int, case: LoadCase) -> _Frame:
    declared = vehicle.bodies[body].bending
    assert declared is not None
    low, high = (declared.x_m[0], declared.x_m[-1]) if declared.x_m else frame_ends(vehicle, body)
    cg_x = float(static_equilibrium(vehicle, case).cg_x_m[body])
    return _Frame(low, high, cg_x, case.sprung_mass_kg[body], case.pitch_inertia_kg_m2[body])


def ends_carry_mass(vehicle: Vehicle, body: int, case: LoadCase) -> bool:
    """Whether the mass assumed along a frame that bends has parts at its ends."""
    centre, variance = _frame(vehicle, body, case).moments
    return min(_three_masses(centre, variance + centre**2)) >= 0.0


def _shape(vehicle: Vehicle, body: int, case: LoadCase) -> tuple[Callable[[float], float], float]:
    """phi of a body and its modal mass [kg]."""
    declared = vehicle.bodies[body].bending
    assert declared is not None
    frame = _frame(vehicle, body, case)
    half, cg_x, mass, inertia = frame.half, frame.cg_x, frame.mass, frame.inertia
    if declared.own_mass is not None:
        return _own_mass(frame, *declared.own_mass)
    at_ends = case.frame_masses[body].at_ends if case.frame_masses else None
    places, shares = mass_along(*frame.moments, _body_words(vehicle, body, case), at_ends)
    x, lumps = frame.middle + half * places, mass * shares

    if declared.x_m:
        spline = CubicSpline(declared.x_m, declared.rise, bc_type="natural")

        def plain(at: np.ndarray) -> np.ndarray:
            return np.asarray(spline(at))
    else:

        def plain(at: np.ndarray) -> np.ndarray:
            return free_beam((np.asarray(at) - frame.low) / (frame.high - frame.low))

    beam = plain(x)
    heave, pitch = float(lumps @ beam) / mass, float(lumps @ (beam * (x - cg_x))) / inertia
    modal_mass = float(lumps @ (beam - heave - pitch * (x - cg_x)) ** 2)
    if case.frame_masses:
        other = case.frame_masses[body]
        heave, pitch = heave + other.heave, pitch + other.pitch / half
        modal_mass *= float(np.exp(other.log_modal_mass))

    def rise(at: float) -> float:
        return float(plain(np.array(at)) - heave - pitch * (at - cg_x))

    return rise, modal_mass


def _own_mass(frame: _Frame, part: float, x_m: float) -> tuple[Callable[[float], float], float]:
    """phi of a rigid frame, and the modal mass [kg], for a part of its mass on springs of its own.

    The mode has no momentum and no moment of momentum: while the part rises by 1 relative to the frame below it, the
    frame rises by phi = -part (1 / m + (x_part - x_cg) (x - x_cg) / I), and the modal mass is part (1 + phi(x_part)).
    """

    def rise(at: float) -> float:
        return -part * (1.0 / frame.mass + (x_m - frame.cg_x) * (at - frame.cg_x) / frame.inertia)

    return rise, part * (1.0 + rise(x_m))


def _body_words(vehicle: Vehicle, body: int, case: LoadCase) -> str:
    return f"load case '{case.name}': the body '{vehicle.bodies[body].name}', whose frame bends,"


def _three_masses(centre: float, second: float) -> tuple[float, float, float]:
    """Shares of a uniform beam and of point masses at -1 and 1, of total 1 and given first and second moment."""
    beam, front, rear = np.linalg.solve([[1.0, 1.0, 1.0], [0.0, -1.0, 1.0], [1 / 3, 1.0, 1.0]], [1.0, centre, second])
    return float(beam), float(front), float(rear)


def mass_along(centre: float, variance: float, what: str, at_ends: bool | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Places on [-1, 1] and the shares of a mass there, of given mean and variance about it, total 1.

    Parameters
    ----------
    at_ends : whether the ends have parts of it; None: where no part is negative. If True an end may lack up to a tenth
        of the mass; beyond that there are no parts.

    Raises
    ------
    CampaignError
        If there is no such mass; the sentence begins with `what`.
    """
    if not (abs(centre) < 1.0 and 0.01 < variance < 0.98 * (1.0 - centre) * (1.0 + centre)):
        raise CampaignError(
            f"{what} has a centre of gravity and a pitch inertia that no mass between its ends can have; "
            "give bending.shape with x_m from one end of the frame to the other, or correct pitch_inertia_kg_m2."
        )
    second = variance + centre**2
    beam, front, rear = _three_masses(centre, second)
    may_lack = _MOST_LACKING if at_ends else 0.0
    if at_ends is not False and min(beam, front, rear) >= -may_lack:
        return np.append(_NODES, [-1.0, 1.0]), np.append(0.5 * beam * _WEIGHTS, [front, rear])
    return _NODES, _WEIGHTS * _even_density(centre, second)


def _even_density(centre: float, second: float) -> np.ndarray:
    """Density of largest entropy at the nodes, of total 1 and given first and second moment."""
    powers = np.stack([_NODES, _NODES**2])
    moments = np.array([centre, second])

    def dual(c: np.ndarray) -> tuple[float, np.ndarray]:
        exponent = c @ powers
        peak = exponent.max()
        weight = _WEIGHTS * np.exp(exponent - peak)
        total = weight.sum()
        return float(peak + np.log(total) - c @ moments), powers @ weight / total - moments

    def curvature(c: np.ndarray) -> np.ndarray:
        exponent = c @ powers
        weight = _WEIGHTS * np.exp(exponent - exponent.max())
        weight /= weight.sum()
        mean = powers @ weight
        return np.asarray((powers * weight) @ powers.T - np.outer(mean, mean))

    c = minimize(dual, np.zeros(2), jac=True, hess=curvature, method="trust-exact", options={"gtol": 1e-13}).x
    for _ in range(3):  # to the last digit
        c = c - np.linalg.solve(curvature(c), dual(c)[1])
    density = np.exp(c @ powers - (c @ powers).max())
    return np.asarray(density / (density @ _WEIGHTS))
