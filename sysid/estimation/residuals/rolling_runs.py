"""Roll of runs or predicted passes: usual values of trucks, and what drives the roll about a planar motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from sysid.arrays import Parameters
from sysid.campaign.statics import chains
from sysid.campaign.wheel_places import across_axle
from sysid.estimation.parameters.axle_laws import LawInputs, axle_laws
from sysid.estimation.residuals.bump_model import SideKey
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.side_unknowns import (
    AXLE_INERTIA,
    BODY_INERTIA,
    CG_SIDE,
    CORNERING,
    DAMPER_SIDE,
    ROLL_DAMPING,
    ROLL_STIFFNESS,
    SKEW,
    SPRING_SIDE,
    TIRE_ROLL,
    TIRE_SIDE,
    SideUnknown,
)
from sysid.vehicle_model import engine
from sysid.vehicle_model.contact import EffectiveRoad, RoadRise, TireLaw, contact_damping, raised_along
from sysid.vehicle_model.engine import Timing
from sysid.vehicle_model.passes import EffectiveRoads, Pass
from sysid.vehicle_model.roll import (
    FrictionBySide,
    RollMotion,
    RollSystem,
    Sideways,
    TiresBySide,
    roll_motion,
)
from sysid.vehicle_model.simulation import Histories
from sysid.vehicle_model.stacked_matrices import StackedMatrices

#: Radius of gyration of bodies about their axis of roll [m], and of axles over half their track: usual values of
#: trucks (assumptions).
_BODY_RADIUS_M, _AXLE_RADIUS = 0.85, 0.76
#: Cornering stiffness of tires over their load [1/rad]: that of radial tires at their rated load in UMTRI-86-12.
_CORNERING = 6.5
#: Roll damping of a suspension over that of its dampers at their track: bushings and leaves damp too (assumption).
_RUBBING = 1.3
#: Roll stiffness of a suspension over that of its springs at their track: leaves twist and axles guide (assumption).
_AUXILIARY = 1.8
#: Roll stiffness of a hitch with the frames beside it [N m/rad] (assumption).
_HITCH = 1e6
#: Step of the derivatives, as a share of a unit.
_SMALL = 1e-3
#: Half of the lowering of a wheel over which a difference is a derivative [m].
_SUNK_M = 1e-4
#: Half of the turn of a bump over which a difference is a derivative [rad].
_TURN_RAD = 1e-4


@dataclass(frozen=True)
class PlanarRuns:
    """Runs of which some, all of one load case, roll.

    - `passes` of all R runs, `rows` those that roll;
    - `felt`: effective roads of the wheels, with the vehicle and its load cases; `tracks`: those whose footprint maps
      of either side are used;
    - `matrices`, `road`, `laws` of the R runs, `axle_x` (na, 1) [m], `motion` of the R runs;
    - `timing`: samples of the roll and their interval, with the integration steps of the planar motion between them;
    - `sides`: amounts by which left and right differ from usual;
    - `rise`: of the R runs, what unlike sides add to `road`, which has it; None for nothing.
    """

    passes: Sequence[Pass]
    rows: np.ndarray
    felt: EffectiveRoads
    tracks: EffectiveRoads
    matrices: StackedMatrices
    road: EffectiveRoad
    laws: LawInputs
    axle_x: np.ndarray
    motion: RunMotion
    timing: Timing
    sides: tuple[tuple[SideKey, float], ...]
    rise: RoadRise | None = None


class RollingRuns:
    """Roll of runs of one load case about their `planar` motion.

    - `step_s`: between the samples of the roll [s]; `system`: their :class:`~sysid.vehicle_model.roll.RollSystem`;
    - `base`: their roll with the amounts of `sides`, one course.
    """

    def __init__(self, planar: PlanarRuns, log_parameters: Parameters):
        self.planar, self._rows = planar, planar.rows
        passes = planar.passes
        self._vehicle = vehicle = planar.felt.vehicle
        self._sides = dict(planar.sides)
        self._passes = [passes[r] for r in planar.rows]
        self.step_s = planar.timing.interval_s
        self._time = self.step_s * np.arange(planar.timing.samples)
        self._case = case = planar.felt.load_cases[self._passes[0].load_case]
        self._across = [across_axle(a) for a in vehicle.axles]
        self._half = np.array([0.5 * a.track_m for a in self._across])

        # The planar motion: loads of the axles, and what acts where the sides differ.
        along, rows = planar.motion, planar.rows
        road = engine.wheel_road(
            planar.matrices, planar.road, planar.axle_x, along.along_road(planar.axle_x), planar.timing
        )
        suspension, tire = axle_laws(planar.laws, log_parameters[:, None])
        found = road.engine.histories(planar.matrices, suspension, tire, road, planar.timing)

        def of_rows(values: object) -> np.ndarray:
            """(R, na) of the rows."""
            full = np.broadcast_to(np.asarray(values), (len(passes), len(vehicle.axles), 1))
            return np.asarray(full[rows, :, 0])

        def course(values: object) -> np.ndarray:
            """(T, na, R) of the rows."""
            return np.asarray(np.moveaxis(np.asarray(values)[..., 0][:, rows], 1, 2))

        static = of_rows(planar.matrices.static_load)[0]
        self._load = course(found.tire_force) - static[:, None]
        self._extension = course(found.deflection)
        self._push = course(found.suspension_force)
        exponent = float(np.asarray(tire.exponent).reshape(-1)[0])
        rest, reference = of_rows(tire.static_deflection)[0], of_rows(tire.reference_deflection)[0]
        growth = of_rows(tire.growth)[0]

        # Axles on a common beam share the suspension of its first one.
        of_axle = list(vehicle.suspension_axle)
        shared = np.array([of_axle.count(i) for i in of_axle])
        self._stiffness = of_rows(suspension.stiffness)[0, of_axle] / shared
        self._damping = of_rows(suspension.damping)[0, of_axle] / shared
        self._of_spring = np.array([0.5 * a.spring_track_m for a in self._across])
        self._of_damper = np.array([0.5 * a.damper_track_m for a in self._across])
        axles, bodies = range(len(vehicle.axles)), range(len(vehicle.bodies))
        factor = self.factor
        in_roll = np.array([factor(TIRE_ROLL, i) for i in axles])
        self.system = RollSystem(
            body_inertia=np.array(case.sprung_mass_kg)
            * _BODY_RADIUS_M**2
            * np.array([factor(BODY_INERTIA, b, case.name) for b in bodies]),
            axle_inertia=np.array(vehicle.unsprung_mass_kg)
            * (_AXLE_RADIUS * self._half) ** 2
            * np.array([factor(AXLE_INERTIA, i) for i in axles]),
            stiffness=_AUXILIARY
            * self._stiffness
            * self._of_spring**2
            * np.array([factor(ROLL_STIFFNESS, i) for i in axles]),
            damping=_RUBBING * self._damping * self._of_damper**2 * np.array([factor(ROLL_DAMPING, i) for i in axles]),
            tire_stiffness=in_roll * exponent * static / rest,
            tire_damping=in_roll * contact_damping(of_rows(tire.damping)[0], rest / reference, growth),
            square_track_m2=np.array([np.mean(np.square(a.tires_m)) for a in self._across]),
            body_of=tuple(a.body for a in vehicle.axles),
            hitches=tuple(pair for chain in chains(vehicle) for pair in pairwise(chain)),
            hitch_stiffness=_HITCH,
            sideways=self._sideways(static, along.of(rows.tolist())),
        )
        some = along.of(rows.tolist())
        since = self._time[:, None] - some.start_s
        travelled = since * (
            some.speed_m_s + 0.5 * np.asarray(some.along_road(planar.axle_x).acceleration)[:, 0] * since
        )
        # (T, na, R)
        self._station = travelled[:, None, :] - planar.axle_x
        body = np.asarray(found.body)[..., 0][:, rows]
        # (T, na, R) rise of the wheels in the planar motion.
        self._height = (
            np.einsum("rib,trb->tir", planar.matrices.position[rows][:, : self._half.size], body) - self._extension
        )
        self._rest = rest
        difference = self._pressed(1.0) - self._pressed(-1.0)
        deflection = self._mean_deflection(found, tire, course)
        self._tires = TiresBySide(
            half_track_m=self._half,
            exponent=exponent,
            deflection=deflection,
            rate=np.gradient(deflection, self.step_s, axis=0),
            difference=difference,
            difference_rate=np.gradient(difference, self.step_s, axis=0),
            gain=self._gain(),
            reference_load=in_roll * of_rows(tire.reference_load)[0],
            reference_deflection=of_rows(tire.reference_deflection)[0],
            damping=in_roll * of_rows(tire.damping)[0],
            growth=growth,
        )
        self._friction = None
        if suspension.friction is not None and suspension.slip is not None:
            self._friction = FrictionBySide(
                self._of_spring,
                of_rows(suspension.friction)[0, of_axle] / shared,
                of_rows(suspension.slip)[0, of_axle],
                self._extension,
            )
        self._given = self._moments_of_sides()[..., None]
        self.base = roll_motion(self.system, self.step_s, self._given, self._tires, self._friction)
        self._slopes = self._tires.slopes(self.base.angle[:, self.system.axles, :, 0])

    def _sideways(self, static_N: np.ndarray, motion: RunMotion) -> Sideways:
        """Lateral motion at the mean speed of the runs, under static axle loads (na,)."""
        vehicle, speed = self._vehicle, motion.mean_speed_m_s
        radius = np.array([a.tire_radius_m for a in vehicle.axles])
        axis = [float(np.mean([a.tire_radius_m for a in vehicle.axles if a.body == b] or radius))
                for b in range(len(vehicle.bodies))]  # fmt: skip
        reference = float(np.mean(speed))
        return Sideways(
            body_mass=np.array(self._case.sprung_mass_kg),
            cg_above_axis_m=np.maximum(np.array(self._case.cg_height_m) - axis, 0.0),
            mass=float(np.sum(self._case.sprung_mass_kg) + np.sum(vehicle.unsprung_mass_kg)),
            cornering=_CORNERING * static_N * self.factor(CORNERING, 0) / reference,
            radius_m=radius,
            slower=reference / speed,
        )

    def _amount(self, kind: str, place: int, load_case: str | None = None, of: str | None = None) -> float:
        return self._sides.get((kind, place, load_case, of), 0.0)

    def factor(self, kind: str, place: int, load_case: str | None = None, of: str | None = None) -> float:
        """What the amounts make of a quantity, over its usual value."""
        return float(np.exp(self._amount(kind, place, load_case, of)))

    def _pressed(self, side: float, turn: float = 0.0, sunk_m: float = 0.0) -> np.ndarray:
        """Deflection u_0 + v + alpha(v) of the tires of a side (T, na, R) [m], if the axles did not roll.

        As :mod:`sysid.vehicle_model.contact` has it, with the footprint maps of the side's own track: 1 for the left
        one, -1 for the right one, 0 for the mean of both. The bump is turned by `turn` [rad] more, and the wheels are
        lower by `sunk_m`.
        """
        felt = self.planar.tracks.of_side(side)
        result = np.zeros_like(self._station)
        for r, driven in enumerate(self._passes):
            sides = self.planar.felt.profiles[driven.bump].sides
            assert sides is not None
            turned = self._amount(SKEW, 0, None, driven.bump) + turn
            for i, tire in enumerate(felt.maps(driven.load_case, driven.bump)):
                ahead = (self._half[i] - sides.at_m) * np.tan(sides.skew_rad) + self._half[i] * turned
                at = self._station[:, i, r] + side * ahead
                inside = (at > tire.station_m[0]) & (at < tire.station_m[-1])
                rows = CubicSpline(tire.station_m, np.stack([tire.rise_m, *tire.stretch, tire.lift_m]), axis=1)
                table = np.zeros((5, at.size))
                table[:, inside] = rows(at[inside])
                rise, *stretch, lift = table
                below = rise - self._height[:, i, r] + sunk_m
                v = np.maximum(below, lift - self._rest[i])
                result[:, i, r] = self._rest[i] + below + v * (stretch[0] + v * (stretch[1] + v * stretch[2]))
        return np.asarray(result)

    def _gain(self, turn: float = 0.0) -> np.ndarray:
        """Derivative of the deflection by the lowering of the wheel, mean of both sides (T, na, R)."""
        lower, upper = (self._pressed(1.0, turn, z) + self._pressed(-1.0, turn, z) for z in (_SUNK_M, -_SUNK_M))
        return np.asarray((lower - upper) / (4.0 * _SUNK_M))

    def _difference_by_skew(self) -> np.ndarray:
        """Derivative of the difference of left and right by the turn of the bump (T, na, R) [m], with the roll."""
        left, right = (self._pressed(side, _TURN_RAD) - self._pressed(side, -_TURN_RAD) for side in (1.0, -1.0))
        gain = self._gain(_TURN_RAD) - self._gain(-_TURN_RAD)
        rolled = self._half[:, None] * self.base.angle[:, self.system.axles, :, 0]
        return np.asarray((left - right - 2.0 * gain * rolled) / (2.0 * _TURN_RAD))

    def _mean_deflection(self, found: Histories, tire: TireLaw, course: Callable[[object], np.ndarray]) -> np.ndarray:
        """Deflection e (T, na, R) of the tires in the planar motion, below 0 by the gap where they are off the road."""
        rows, axles = self._rows, len(self._vehicle.axles)
        exponent = float(np.asarray(tire.exponent).reshape(-1)[0])

        def of_rows(values: object) -> np.ndarray:
            """(na, R) of the rows."""
            full = np.broadcast_to(np.asarray(values), (len(self.planar.passes), axles, 1))
            return np.asarray(full[rows, :, 0].T)

        force = course(found.tire_force)
        share = np.maximum(force, 0.0) / of_rows(tire.reference_load)
        pressed = of_rows(tire.reference_deflection) * share ** (1.0 / exponent)
        # On a road that is raised for them, both sides together are pressed in by as much more than their mean.
        pressed -= self._rise()
        return np.asarray(np.where(force > 0.0, pressed, np.minimum(self._pressed(0.0), 0.0)))

    def _rise(self) -> np.ndarray:
        """What the road of the planar motion has beside its own height under the wheels (T, na, R) [m]."""
        total, rise = np.zeros_like(self._station), self.planar.rise
        if rise is not None:
            for r, run in enumerate(self._rows):
                for i, heights in enumerate(rise.height_m[run]):
                    total[:, i, r] = np.interp(self._station[:, i, r], rise.station_m, heights, left=0.0, right=0.0)
        return np.asarray(total)

    def raised(self) -> PlanarRuns:
        """The planar runs, of which all roll, on a road with the :meth:`rise` of their wheels."""
        own, step = self.planar.road.station_m, self.planar.road.step_m
        station = own[0] + step * np.arange(max(own.size, int((self._station.max() - own[0]) / step)))
        rise = RoadRise(station, self.rise(station))
        return replace(self.planar, road=raised_along(self.planar.road, rise), rise=rise)

    def rise(self, station_m: np.ndarray) -> np.ndarray:
        """What the mean road must have more for the force of both sides, at stations (m,): (R, na, m) [m].

            F((e + rise) / u_ref) = (1 + s) F((e + a) / u_ref) / 2 + (1 - s) F((e - a) / u_ref) / 2

        with the deflections e + a and e - a of the sides and what the left tires have more, s. It is a where one side
        is off the road: the other one carries.
        """
        return self._at_stations(self._risen(self._apart), station_m)

    def rise_columns(self, station_m: np.ndarray, unknowns: Sequence[SideUnknown], moved: RollMotion) -> np.ndarray:
        """Derivatives (q, R, na, m) of :meth:`rise` by unknowns, whose roll is `moved`."""
        base = self._risen(self._apart)
        columns = np.zeros((len(unknowns), len(self._rows), self._half.size, station_m.size))
        for j, u in enumerate(unknowns):
            apart = -self._half[:, None] * self._tires.gain * moved.angle[:, self.system.axles, :, j]
            if u.kind == SKEW:
                apart += 0.5 * self._difference_by_skew() * np.array([p.bump == u.of for p in self._passes])
            step = _SMALL * u.sd
            columns[j] = self._at_stations((self._risen(self._apart + step * apart) - base) / step, station_m)
        return columns

    @property
    def _apart(self) -> np.ndarray:
        """By how much the tires of the left side are pressed in more than the mean (T, na, R) [m]."""
        angle = self.base.angle[:, self.system.axles, :, 0]
        return np.asarray(0.5 * self._tires.difference - self._half[:, None] * self._tires.gain * angle)

    def _risen(self, apart: np.ndarray) -> np.ndarray:
        """The rise of the mean road where sides are apart by as much (T, na, R) [m]."""
        tires, exponent = self._tires, self._tires.exponent
        more = np.array([self._amount(TIRE_SIDE, i) for i in range(self._half.size)])[:, None]
        reference = tires.reference_deflection[:, None]
        left, right = (
            np.maximum((tires.deflection + sign * apart) / reference, 0.0) ** exponent for sign in (1.0, -1.0)
        )
        force = 0.5 * ((1.0 + more) * left + (1.0 - more) * right)
        # In the air it is as when the first wheel lands.
        together = np.where(force > 0.0, reference * force ** (1.0 / exponent), tires.deflection + np.abs(apart))
        return np.asarray(together - tires.deflection)

    def _at_stations(self, of_wheels: np.ndarray, station_m: np.ndarray) -> np.ndarray:
        """Courses of the wheels (T, na, R) along the road, at stations (m,): (R, na, m), zero where they were not."""
        found = np.zeros((len(self._rows), self._half.size, station_m.size))
        for r in range(len(self._rows)):
            for i in range(self._half.size):
                at = self._station[:, i, r]
                found[r, i] = np.interp(station_m, at, of_wheels[:, i, r], left=0.0, right=0.0)
        return found

    def _of_tires(self, difference: np.ndarray) -> np.ndarray:
        """Moment (T, na, R) on the axles from a small difference of the road under both sides."""
        stiffness, damping = self._slopes
        rate = np.gradient(difference, self.step_s, axis=0)
        return np.asarray(0.5 * self._half[:, None] * (stiffness * difference + damping * rate))

    def _all(self, of_axles: np.ndarray | None = None, of_suspensions: np.ndarray | None = None) -> np.ndarray:
        """Moments (T, n, R) from those on axles, and those that suspensions put on the body above, (T, na, R)."""
        given = of_axles if of_axles is not None else of_suspensions
        assert given is not None
        total = np.zeros((given.shape[0], self.system.inertia.shape[0], given.shape[2]))
        if of_axles is not None:
            total[:, self.system.axles] += of_axles
        if of_suspensions is not None:
            total += np.einsum("in,tir->tnr", self.system.turns, of_suspensions)
        return total

    def _by_side(self, kind: str, place: int) -> np.ndarray:
        """Moment (T, n, R) per unit of what one side has more than the other."""
        only = np.zeros((len(self._vehicle.axles), 1))
        only[place] = 1.0
        if kind == SPRING_SIDE:
            pull = self._stiffness[:, None] * self._extension
            return self._all(of_suspensions=-only * self._of_spring[:, None] * pull)
        if kind == DAMPER_SIDE:
            pull = self._damping[:, None] * np.gradient(self._extension, self.step_s, axis=0)
            return self._all(of_suspensions=-only * self._of_damper[:, None] * pull)
        if kind == TIRE_SIDE:
            return self._all(of_axles=only * self._half[:, None] * self._load)
        total = np.zeros((self._time.size, self.system.inertia.shape[0], len(self._rows)))
        above = [i for i, a in enumerate(self._vehicle.axles) if a.body == place]
        total[:, place] = -self._push[:, above].sum(axis=1)
        return total

    def _moments_of_sides(self) -> np.ndarray:
        """Moments (T, n, R) of sides that differ."""
        total = np.zeros((self._time.size, self.system.inertia.shape[0], len(self._rows)))
        for (kind, place, load_case, _), amount in self._sides.items():
            if kind in (SPRING_SIDE, DAMPER_SIDE, TIRE_SIDE, CG_SIDE) and load_case in (None, self._case.name):
                total += amount * self._by_side(kind, place)
        return total

    def roll(self, moments: np.ndarray) -> RollMotion:
        """Changes of the roll by moments (T, n, R, Q), to first order."""
        given = self._given + _SMALL * moments
        moved = roll_motion(self.system, self.step_s, given, self._tires, self._friction)
        pairs = (
            (moved.angle, self.base.angle),
            (moved.rate, self.base.rate),
            (moved.acceleration, self.base.acceleration),
        )
        return RollMotion(*((there - here) / _SMALL for there, here in pairs))

    def derivative(self, unknown: SideUnknown) -> np.ndarray:
        """Moment (T, n, R) that has the effect of one unit of an unknown on the roll."""
        system, place, kind = self.system, unknown.place, unknown.kind
        none = np.zeros((self._time.size, system.inertia.shape[0], len(self._rows)))
        if unknown.load_case not in (None, self._case.name):
            return none
        angle, rate, acceleration = (x[..., 0] for x in (self.base.angle, self.base.rate, self.base.acceleration))
        if kind == SKEW:
            met = np.array([p.bump == unknown.of for p in self._passes])
            return self._all(of_axles=self._of_tires(self._difference_by_skew()) * met)
        if kind in (SPRING_SIDE, DAMPER_SIDE, TIRE_SIDE, CG_SIDE):
            return self._by_side(kind, place)
        if kind in (BODY_INERTIA, AXLE_INERTIA):
            at = place if kind == BODY_INERTIA else system.bodies + place
            of_kind = system.body_inertia if kind == BODY_INERTIA else system.axle_inertia
            none[:, at] = -of_kind[place] * acceleration[:, at]
            return none
        if kind == CORNERING:
            assert system.sideways is not None
            return np.asarray(-system.sideways.slower * np.einsum("mn,tnr->tmr", system.slipping, rate))
        if kind in (ROLL_STIFFNESS, ROLL_DAMPING):
            turned = np.einsum("n,tnr->tr", system.turns[place], angle if kind == ROLL_STIFFNESS else rate)
            size = (system.stiffness if kind == ROLL_STIFFNESS else system.damping)[place]
            return np.asarray(-size * turned[:, None] * system.turns[place][:, None])
        if kind == TIRE_ROLL:
            at = system.bodies + place
            square = system.square_track_m2[place]
            stiffness, damping = (of_all[:, place] for of_all in self._slopes)
            none[:, at] = self._of_tires(self._tires.difference)[:, place] - square * self._tires.gain[:, place] * (
                stiffness * angle[:, at] + damping * rate[:, at]
            )
        return none

    def load_difference(self) -> np.ndarray:
        """Dynamic load of left wheels beyond that of right ones (T, na, R) [N]."""
        total = self._of_rolling(self.base)[..., 0]
        for i in range(total.shape[1]):
            # Tires of which one side carries more do so in the mean motion, too.
            total[:, i] += self._amount(TIRE_SIDE, i) * self._load[:, i]
        return total

    def load_difference_columns(self, unknowns: Sequence[SideUnknown]) -> np.ndarray:
        """Derivatives (T, na, R, q) of :meth:`load_difference` by unknowns."""
        moved = self.roll(np.stack([self.derivative(u) for u in unknowns], axis=-1))
        base, axles = self.base, self.system.axles
        rolled = RollMotion(
            base.angle + _SMALL * moved.angle,
            base.rate + _SMALL * moved.rate,
            base.acceleration + _SMALL * moved.acceleration,
        )
        columns = (self._of_rolling(rolled) - self._of_rolling(base)) / _SMALL
        stiffness, damping = self._slopes
        for j, u in enumerate(unknowns):
            if u.kind == TIRE_SIDE:
                columns[:, u.place, :, j] += self._load[:, u.place]
            elif u.kind == TIRE_ROLL:
                i = u.place
                lever = self._half[:, None] * self._tires.gain
                apart = 0.5 * self._tires.difference - lever * base.angle[:, axles, :, 0]
                moving = 0.5 * self._tires.difference_rate - lever * base.rate[:, axles, :, 0]
                columns[:, i, :, j] += stiffness[:, i] * apart[:, i] + damping[:, i] * moving[:, i]
            elif u.kind == SKEW:
                met = np.array([p.bump == u.of for p in self._passes])
                columns[..., j] += met * self._of_tires(self._difference_by_skew()) / self._half[:, None]
        return np.asarray(columns)

    def _of_rolling(self, motion: RollMotion) -> np.ndarray:
        """Load of left wheels beyond that of right ones (T, na, R, Q) that a roll makes [N]."""
        axles = self.system.axles
        left, right = self._tires.forces(slice(None), motion.angle[:, axles], motion.rate[:, axles])
        return np.asarray(left - right)

    def rest_difference(self) -> np.ndarray:
        """Load of left wheels beyond that of right ones at rest (na,) [N]."""
        case = self._case.name
        amounts = [self._amount(CG_SIDE, b, case) for b in range(self.system.bodies)]
        return np.asarray(self._rest_by_place @ np.array(amounts))

    def rest_difference_columns(self, unknowns: Sequence[SideUnknown]) -> np.ndarray:
        """Derivatives (na, q) of :meth:`rest_difference` by unknowns."""
        columns = np.zeros((self._half.size, len(unknowns)))
        for j, u in enumerate(unknowns):
            if u.kind == CG_SIDE and u.load_case == self._case.name:
                columns[:, j] = self._rest_by_place[:, u.place]
        return columns

    @property
    def _rest_by_place(self) -> np.ndarray:
        """Load of left wheels beyond right ones (na, nb) per metre of a body's centre of gravity to the left [N/m]."""
        turning = slice(0, self.system.axles.stop)
        stiffness = self.system.stiffness_matrix[turning, turning]
        weight = np.zeros((stiffness.shape[0], self.system.bodies))
        weight[: self.system.bodies] = -np.diag(self._case.sprung_mass_kg) * self._vehicle.gravity_m_s2
        angle = np.linalg.solve(stiffness, weight)[self.system.axles]
        return np.asarray(-(self._half * self.system.tire_stiffness)[:, None] * angle)
