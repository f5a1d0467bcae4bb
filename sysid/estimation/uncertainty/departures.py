"""Departures of the vehicle from the model: physics that the model leaves out, each with an amplitude.

In the model, a tire rolls over its footprint in one way, its stiffness grows with load by one exponent, its damping
grows with its contact, a linear suspension has no friction, dampers are held rigidly, and wheels go straight up. A real
truck differs a little in all of these. A departure is a direction in which the simulation can be moved towards such
other physics; amplitude 0 is the model. Amplitudes are estimated, with priors whose size follows from the data
(:mod:`sysid.estimation.uncertainty.departure_scale`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from sysid.arrays import RunsByAxles
from sysid.campaign.statics import carried_by_suspensions
from sysid.estimation.parameters.axle_laws import ElementIndex, LawInputs
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.road.contact_laws import CONTACT_LAWS
from sysid.road.enveloping import FootprintMap
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.passes import EffectiveRoads, Pass

#: Logarithms (n, axles) of axle loads over the declared ones in n load cases.
LoadChanges: TypeAlias = Callable[[Sequence[str]], RunsByAxles]

#: Kinds of departures: how the tire envelops the bump (0 for the chosen contact law, 1 for another one); size of the
#: footprint (logarithm of the factor on the tire stiffness for which it is computed); stiffening of single spokes
#: (exponent in addition to that of the law); tire stiffness in a further load case (logarithm); friction over the
#: carried load; compliance of the rubber bushings in series with an axle's dampers [mm/kN]; height of the driven bumps
#: over that of their scans, less one: bumps give way under wheels; how far a wheel goes aft over its jounce; how far
#: the damping of a tire is from growing with its contact (0) towards a constant (1).
ENVELOPE, FOOTPRINT, SPOKES, TIRE_LOAD = "envelope", "footprint", "spokes", "tire_load"
FRICTION, BUSHING, BUMP, TRAILING = "friction", "bushing", "bump", "links"
TIRE_DAMPING = "tire_damping"
#: Kinds whose amplitudes are not negative: friction that pushes, rubber that pushes back, and tires that no longer damp
#: where they are about to leave the road, do not exist.
ONE_SIDED = (FRICTION, BUSHING, TIRE_DAMPING)
#: Amplitude in SI units: mm/kN in m/N.
_COMPLIANCE = 1e-6
#: No draw of a vehicle departs further than this, two to three and a third times the scale that is plausible without
#: data (:data:`sysid.estimation.uncertainty.departure_scale.PLAUSIBLE`): an assumption, as a
#: direction holds near the model only.
REACH = {
    ENVELOPE: 2.0,
    FOOTPRINT: 0.5,
    SPOKES: 0.5,
    TIRE_LOAD: 0.3,
    FRICTION: 0.1,
    BUSHING: 0.8,
    BUMP: 0.15,
    TRAILING: 0.3,
    TIRE_DAMPING: 1.0,
}
#: Steps of log stiffness and of the spokes' exponent from which the directions of contact are differences.
_SOFTER, _STIFFENING = 0.1, 0.1
#: Slip length of friction that the model does not have: that of the friction law, an assumption.
_SLIP_M = 1e-3
#: Amplitude of bushings below which an optimum has none: of 1 GN/m, fifty times the stiffest, which give way by a
#: hundredth of a millimetre under 10 kN.  Simulations would take half as long again for less than anybody could see.
RIGID = 1e-3
#: Padded maps end at multiples of this.
_WHOLE_M = 1.0


@dataclass(frozen=True)
class Departure:
    """One direction: its `kind`, the axle index, and the load case, None where it is shared by all.

    Without an axle it is the common part of all directions of its kind: tires of one make envelop a bump in the same
    way.
    """

    kind: str
    axle: int | None
    load_case: str | None = None

    @property
    def name(self) -> str:
        """Name for tables."""
        if self.axle is None:
            return self.kind
        return f"{self.kind}_{self.axle + 1}" + ("" if self.load_case is None else f"[{self.load_case}]")

    @property
    def group(self) -> str:
        """Directions of one group have one scale."""
        return self.kind if self.axle is not None else f"{self.kind} of all"


@dataclass(frozen=True)
class Departures:
    """The directions of one vehicle over its bumps; `roads` are the effective roads of its wheels at amplitude 0.

    `driven` are the bumps that runs went over, whose heights they show.
    """

    roads: EffectiveRoads
    directions: tuple[Departure, ...]
    driven: frozenset[str] = frozenset()
    # Maps of a bump take a while: they are made once.
    _blends: dict[tuple[Pass, ...], BlendedRoad] = field(default_factory=dict, repr=False, compare=False)

    def over(self, roads: EffectiveRoads) -> Departures:
        """The same directions over other roads."""
        return Departures(roads, self.directions, self.driven)

    def common(self, amplitudes: np.ndarray) -> np.ndarray:
        """What every direction of an axle (n,) has in common with the others of its kind; 0 for the common parts."""
        shared = {d.kind: float(a) for d, a in zip(self.directions, amplitudes, strict=True) if d.axle is None}
        return np.array([0.0 if d.axle is None else shared.get(d.kind, 0.0) for d in self.directions])

    def spread(self, kind: str, amplitudes: np.ndarray, load_cases: Sequence[str]) -> np.ndarray:
        """Amplitudes (R, na) of one kind in passes of the given load cases, from those of all directions (n,)."""
        by_pass = np.zeros((len(load_cases), len(self.roads.vehicle.axles)))
        for direction, value in zip(self.directions, amplitudes + self.common(amplitudes), strict=True):
            if direction.kind == kind and direction.axle is not None:
                affected = [direction.load_case in (None, case) for case in load_cases]
                by_pass[affected, direction.axle] = min(max(value, -REACH[kind]), REACH[kind])
        return by_pass

    def laws(
        self, inputs: LawInputs, amplitudes: np.ndarray, load_cases: Sequence[str], *, all_elements: bool = False
    ) -> LawInputs:
        """Law inputs of passes moved along the directions of tires, friction, bushings and links.

        Bushings that do not give way, and links of wheels that go straight up, are left out, because they take time;
        with `all_elements` all vehicles have them.
        """
        stiffer = np.exp(self.spread(TIRE_LOAD, amplitudes, load_cases))[..., None]
        values = self._friction(amplitudes, load_cases)
        bushings = self._bushings(amplitudes, load_cases)
        if all_elements or np.isfinite(bushings).any():
            values["bushing_stiffness"] = bushings
        elements, none = dict(inputs.elements), np.full(len(self.roads.vehicle.axles), -1)
        for quantity, value in values.items():
            elements[quantity] = elements.get(quantity, ElementIndex(none, value))._replace(neutral=value)
        trailing = self.spread(TRAILING, amplitudes, load_cases)[0]
        links = trailing if all_elements or trailing.any() else None
        growth = 1.0 - self.spread(TIRE_DAMPING, amplitudes, load_cases)[..., None]
        return inputs._replace(tire_factor=stiffer, tire_growth=growth, elements=elements, trailing=links)

    def _friction(self, amplitudes: np.ndarray, load_cases: Sequence[str]) -> dict[str, np.ndarray]:
        """Quantities (na,) of friction on axles whose laws have none; empty where all have."""
        if not any(d.kind == FRICTION for d in self.directions):
            return {}
        rubbing = np.maximum(self.spread(FRICTION, amplitudes, load_cases)[0], 0.0)
        vehicle, first = self.roads.vehicle, next(iter(self.roads.load_cases.values()))
        carried = (
            carried_by_suspensions(vehicle)
            @ (np.array(first.axle_loads_kg) - vehicle.unsprung_mass_kg)
            * vehicle.gravity_m_s2
        )
        return {"friction": rubbing * carried, "slip_length": np.full(carried.size, _SLIP_M)}

    def _bushings(self, amplitudes: np.ndarray, load_cases: Sequence[str]) -> np.ndarray:
        """Stiffness (na,) [N/m] of bushings on axles whose laws have none, infinite where they do not give way."""
        compliance = _COMPLIANCE * np.maximum(self.spread(BUSHING, amplitudes, load_cases)[0], 0.0)
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / compliance)

    @property
    def per_load(self) -> float:
        """Footprint amplitude per logarithm of the load: deflections go with load^(1/n) over stiffness."""
        return -1.0 / (self.roads.tires.spoke_exponent + 0.5 if CONTACT_LAWS[self.roads.contact].follows_tires else 1.0)

    def footprints_by_loads(self, load_changes: LoadChanges) -> np.ndarray:
        """Amplitudes (n,) of all directions by which loads other than the declared ones move the footprints."""
        amplitudes = np.zeros(len(self.directions))
        for j, d in enumerate(self.directions):
            if d.kind == FOOTPRINT and d.axle is not None and d.load_case is not None:
                amplitudes[j] = self.per_load * load_changes([d.load_case])[0, d.axle]
        return amplitudes

    def road(
        self, passes: Sequence[Pass], amplitudes: np.ndarray, load_changes: RunsByAxles | None = None
    ) -> EffectiveRoad:
        """The effective road of passes moved along the directions of contact.

        Parameters
        ----------
        load_changes : logarithms of the axle loads over the declared ones: under a larger load the footprint is that of
            a softer tire.
        """
        if not self.directions and (load_changes is None or not load_changes.any()):
            return self.roads.stacked(passes)
        cases = [p.load_case for p in passes]
        kinds = ENVELOPE, FOOTPRINT, SPOKES, BUMP
        envelope, footprint, spokes, higher = (self.spread(kind, amplitudes, cases) for kind in kinds)
        if load_changes is not None:
            footprint = footprint + self.per_load * load_changes
        higher[[p.bump not in self.driven for p in passes]] = 0.0
        return self.blend(tuple(passes)).moved(envelope, footprint, spokes, higher)

    def model(
        self,
        model: BumpModel,
        amplitudes: np.ndarray,
        load_changes: Callable[[Sequence[str]], RunsByAxles] | None = None,
    ) -> BumpModel:
        """The model of bump runs moved along all directions by `amplitudes`, (n,).

        Parameters
        ----------
        load_changes : logarithms of the axle loads over the declared ones in load cases, None for loads as declared.
        """
        roads, first = [], 0
        changes = None if load_changes is None else load_changes([p.load_case for g in model.passes for p in g])
        for passes in model.passes:
            of_group = None if changes is None else changes[first : first + len(passes)]
            roads.append(self.road(passes, amplitudes, of_group))
            first += len(passes)
        return self.on_same_roads(model, amplitudes).on_roads(roads)

    def on_same_roads(self, model: BumpModel, amplitudes: np.ndarray) -> BumpModel:
        """The model of bump runs moved along the directions of tires and suspensions by `amplitudes`, (n,)."""
        of_groups = zip(model.arrays, model.passes, strict=True)
        arrays = (
            old._replace(laws=self.laws(old.laws, amplitudes, [p.load_case for p in passes]))
            for old, passes in of_groups
        )
        return replace(model, arrays=tuple(arrays))

    @cached_property
    def sources(self) -> tuple[EffectiveRoads, ...]:
        """Roads as the model has them, by another contact law, under softer tires, and by spokes that stiffen more."""
        here = self.roads
        softer = replace(
            here.tires, stiffness_N_per_m=tuple(k * np.exp(-_SOFTER) for k in here.tires.stiffness_N_per_m)
        )
        stiffening = replace(here.tires, spoke_exponent=here.tires.spoke_exponent + _STIFFENING)
        others = ((CONTACT_LAWS[here.contact].other, here.tires), (here.contact, softer), (here.contact, stiffening))
        return (here, *(EffectiveRoads(here.vehicle, here.load_cases, here.profiles, c, t) for c, t in others))

    def blend(self, passes: tuple[Pass, ...]) -> BlendedRoad:
        """The effective road of passes, and its differences to those of the other kinds of contact."""
        if passes not in self._blends:
            self._blends[passes] = BlendedRoad(*_padded_maps(self, passes))
        return self._blends[passes]


@dataclass(frozen=True)
class BlendedRoad:
    """The model's effective road and its changes per unit amplitude of the kinds of contact, on common stations."""

    base: EffectiveRoad
    envelope: EffectiveRoad
    footprint: EffectiveRoad
    spokes: EffectiveRoad

    def moved(
        self, envelope: RunsByAxles, footprint: RunsByAxles, spokes: RunsByAxles, higher: RunsByAxles
    ) -> EffectiveRoad:
        """The road with amplitudes (R, na); splines are linear in their values, so coefficients add up.

        What a bump adds to a flat road, its effective height and how it changes the footprint, is in proportion to its
        height.
        """
        base = self.base
        assert base.stretch is not None
        assert base.drag is not None

        ways = ((envelope, self.envelope), (footprint, self.footprint), (spokes, self.spokes))
        # The derivatives of a fit move one of them at a time.
        used = [(amplitude[..., None], way) for amplitude, way in ways if amplitude.any()]

        def sum_of(name: str) -> np.ndarray:
            total = np.array(getattr(base, name))
            for amplitude, way in used:
                total += amplitude * getattr(way, name)
            return total * (1.0 + higher[..., None]) if higher.any() else total

        return replace(base, rise=sum_of("rise"), stretch=sum_of("stretch"), drag=sum_of("drag"))


def departures(
    roads: EffectiveRoads,
    used_cases: Sequence[str],
    modelled: Collection[tuple[str, int]] = (),
    driven: Collection[str] = (),
) -> Departures:
    """Directions of a vehicle in the load cases in use.

    Parameters
    ----------
    modelled : kinds and axles of what is no departure, because the law of the axle has it or is compared for it.
    driven : bumps that runs go over.
    """
    axles = range(len(roads.vehicle.axles))
    first = next(iter(roads.load_cases))
    directions = [Departure(kind, i, case) for kind in (ENVELOPE, FOOTPRINT) for case in used_cases for i in axles]
    directions += [Departure(TIRE_LOAD, i, case) for case in used_cases if case != first for i in axles]
    directions += [Departure(TIRE_DAMPING, i) for i in axles]
    # Other contact laws have no spokes.
    directions += [Departure(BUMP, i) for i in axles if driven]
    directions += [Departure(SPOKES, i) for i in axles if CONTACT_LAWS[roads.contact].follows_tires]
    suspended = sorted(set(roads.vehicle.suspension_axle))
    directions += [Departure(kind, i) for kind in (FRICTION, BUSHING) for i in suspended if (kind, i) not in modelled]
    # The wheels of a beam turn with it.
    alone = set(axles) - {i for group in roads.vehicle.groups for i in group.axles}
    directions += [Departure(TRAILING, i) for i in sorted(alone)]
    common = [Departure(kind, None) for kind in dict.fromkeys(d.kind for d in directions)]
    return Departures(roads, (*directions, *common), frozenset(driven))


class _Padded(EffectiveRoads):
    """Maps of an inner source on stations wide enough for all sources."""

    def __init__(self, inner: EffectiveRoads, reach_m: tuple[float, float]):
        self._inner, self._reach_m = inner, reach_m
        self.tires, self.vehicle = inner.tires, inner.vehicle

    def maps(self, load_case: str, bump: str, run: str = "") -> tuple[FootprintMap, ...]:
        maps = self._inner.maps(load_case, bump, run)
        first, last = (round(x / maps[0].step_m) for x in self._reach_m)
        return tuple(m.widened(first, last) for m in maps)


def _padded_maps(known: Departures, passes: Sequence[Pass]) -> tuple[EffectiveRoad, ...]:
    sources = known.sources
    maps = [m for s in sources for p in passes for m in s.maps(*p.key)]
    # Whole metres: what the reference engine compiles for one length of table serves other tires as well.
    first, last = min(float(m.station_m[0]) for m in maps), max(float(m.station_m[-1]) for m in maps)
    reach = (float(np.floor(first / _WHOLE_M) * _WHOLE_M), float(np.ceil(last / _WHOLE_M) * _WHOLE_M))
    base, other, softer, stiffening = (_Padded(s, reach).stacked(passes) for s in sources)

    def minus(one: EffectiveRoad, unit: float, *, lifted: bool = True) -> EffectiveRoad:
        assert one.stretch is not None
        assert base.stretch is not None
        assert one.drag is not None
        assert base.drag is not None
        stretch = (one.stretch - base.stretch) / unit
        if not lifted:
            # Only with radial springs is it known where the wheel is clear of the road.
            stretch[3] = 0.0
        return replace(base, rise=(one.rise - base.rise) / unit, stretch=stretch, drag=(one.drag - base.drag) / unit)

    return base, minus(other, 1.0, lifted=False), minus(softer, -_SOFTER), minus(stiffening, _STIFFENING)
