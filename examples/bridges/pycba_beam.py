"""The calibrated truck on a continuous beam by PyCBA: axle loads at rest, and those in motion where they are.

    python examples/bridges/pycba_beam.py river.toml output/models/laden/vehicle.csv output/moving_forces/NAME.csv

prints the largest moment at the middle of every span.  The beam does not move, so the second one is the load effect
that `predict --bridge` calls rolling.
"""

from __future__ import annotations

import sys

import numpy as np
import pycba
from files import read_axles, read_bridge, read_forces

#: Step of the truck at rest [m].
STEP_M = 0.1
_SUPPORTS = {"pinned": [-1, 0], "fixed": [-1, -1], "free": [0, 0]}

river, vehicle, forces = sys.argv[1:4]
bridge = read_bridge(river)
beam = pycba.BeamAnalysis(bridge.spans_m, bridge.stiffness_N_m2, [r for s in bridge.supports for r in _SUPPORTS[s]])
starts = np.cumsum([0.0, *bridge.spans_m])


def moments(stations: list[float], loads: list[float]) -> list[float]:
    """Moments at the middles of the spans [N m] under point loads."""
    on = [(s, p) for s, p in zip(stations, loads, strict=True) if 0.0 < s < starts[-1]]
    span = [min(int(np.searchsorted(starts, s, side="right")), len(bridge.spans_m)) for s, _ in on]
    beam.set_loads([[n, 2, p, s - starts[n - 1], 0] for n, (s, p) in zip(span, on, strict=True)])
    beam.analyze()
    found = beam.beam_results.results
    return [float(np.interp(at, found.x, found.M)) for at in bridge.middles_m]


x, at_rest = read_axles(vehicle)
fronts = np.arange(0.0, starts[-1] + x[-1], STEP_M)
static = np.max([moments([f - at for at in x], at_rest) for f in fronts], axis=0)
_, stations, loads = read_forces(forces)
rolling = np.max([moments(s, p) for s, p in zip(stations, loads, strict=True)], axis=0)

print("section_m,static_kN_m,rolling_kN_m")
for at, one, other in zip(bridge.middles_m, static, rolling, strict=True):
    print(f"{at:g},{one / 1e3:.3f},{other / 1e3:.3f}")
