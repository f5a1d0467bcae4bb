"""The phases in which an optimum is searched, as values: what for, and how exactly.

Footprint maps belong to tires, and the search changes these. So it goes through phases: a first one under the maps that
there are, again under maps of the tires that it has found until they are alike, and a last one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from sysid.estimation.fit.options import FitOptions, Phase
from sysid.road.contact_laws import CONTACT_LAWS

#: Footprint maps are made again at most so often before the last phase; each time their tires come about five times
#: closer to those of the optimum under them.
_MAPS = 4
#: For the tires of the maps, weights and minimum need not be exact; from another optimum, the search ends after so many
#: iterations: parameters that the data hardly see creep on for long.
_MAPS_TOLERANCE, _MAPS_ITERATIONS = 1e-5, 8
#: Laws that do not suit a truck are not fitted to the end: the expected gain of richer ones is known long before.
_SIGHT_TOLERANCE, _SIGHT_ITERATIONS = 1e-3, 15
#: Two lists of runs are told apart long before.
_GLANCE_ITERATIONS = 6
#: Trials of laws are compared by costs that end here, or roughly where the result is clear.
_TRIAL_TOLERANCE, _ROUGH_TOLERANCE = 1e-6, 1e-3
#: Iterations after which the fit ends with which trials are compared. Parameters about which the data say little move
#: slowly for a long time, and change the cost by far less than a deciding gain.
_BASE_ITERATIONS = 20


@dataclass(frozen=True)
class SearchPlan:
    """Phases on the way to an optimum.

    - `first`: under the maps of the optimum that it starts from, or of the declared tires;
    - `map_rounds`: how often, at most, it is repeated under maps of the tires that it has found;
    - `last`: under the maps of the last of these; None to end before.

    `scans_stops`: whether it goes on from stops that a scan finds at the end
    (:mod:`sysid.estimation.fit.travel_scan`).
    """

    first: Phase
    map_rounds: int = 0
    last: Phase | None = None
    scans_stops: bool = False

    @property
    def end(self) -> Phase:
        """The phase that it ends with."""
        return self.last or self.first


#: A plan by the settings of the fit, and by whether the search starts from another optimum.
Plan = Callable[[FitOptions, bool], SearchPlan]


def exact(options: FitOptions, near: bool) -> SearchPlan:
    """All rounds of weights, and the integration steps of the settings."""
    return _under_own_maps(options, near, options.phase())


def before_joint(options: FitOptions, near: bool) -> SearchPlan:
    """Where the joint optimum begins, which weighs residuals again and ends with exact steps."""
    return _under_own_maps(options, near, options.phase(weight_rounds=1, larger_steps=True))


def first_sight(options: FitOptions, near: bool) -> SearchPlan:
    """Enough to judge residuals by."""
    first = options.phase(
        weight_rounds=1, tolerance=_SIGHT_TOLERANCE, max_iterations=_SIGHT_ITERATIONS, larger_steps=True
    )
    if options.preview:
        return SearchPlan(replace(first, before_weights=_SIGHT_TOLERANCE))
    return SearchPlan(first, 0 if near or not _follows(options) else 1)


def glance(options: FitOptions) -> Phase:
    """Enough to see which of two lists of runs suits the truck."""
    return options.phase(
        weight_rounds=0, tolerance=_SIGHT_TOLERANCE, max_iterations=_GLANCE_ITERATIONS, larger_steps=True
    )


def base(options: FitOptions, near: bool) -> SearchPlan:
    """What trials of laws are compared with."""
    last = options.phase(
        weight_rounds=1, tolerance=_TRIAL_TOLERANCE, max_iterations=_BASE_ITERATIONS, larger_steps=True
    )
    return replace(_under_own_maps(options, near, last), scans_stops=True)


def trial(options: FitOptions, _near: bool) -> SearchPlan:
    """Under weights and maps of the optimum that it is compared with."""
    return SearchPlan(options.phase(weight_rounds=0, tolerance=_TRIAL_TOLERANCE, larger_steps=True))


def rough_trial(options: FitOptions, _near: bool) -> SearchPlan:
    """The same where the result is clear."""
    return SearchPlan(options.phase(weight_rounds=0, tolerance=_ROUGH_TOLERANCE, larger_steps=True))


def _under_own_maps(options: FitOptions, near: bool, last: Phase) -> SearchPlan:
    """The phases before `last` that find the tires of its maps."""
    if not _follows(options):
        return SearchPlan(last)
    first = Phase(
        min(last.weight_rounds, 1),
        max(last.tolerance, _MAPS_TOLERANCE),
        min(last.max_iterations, _MAPS_ITERATIONS) if near else last.max_iterations,
        larger_steps=True,
    )
    return SearchPlan(first, _MAPS, last)


def _follows(options: FitOptions) -> bool:
    return CONTACT_LAWS[options.contact].follows_tires
