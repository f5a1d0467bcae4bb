"""Dynamic axle loads on a beam that moves, by OpenSeesPy.

    python examples/bridges/openseespy_beam.py river.toml output/moving_forces/NAME.csv

prints the largest moment and deflection at the middle of every span, which `predict --bridge` calls dynamic: the axle
loads of a pass over a bridge have felt that it moves.
"""

from __future__ import annotations

import sys

import numpy as np
import openseespy.opensees as ops
from files import read_bridge, read_forces

#: Elements of every span, modes with the damping ratio of the bridge, and steps of the integration per row of forces.
ELEMENTS, MODES, STEPS = 40, 10, 2

river, forces = sys.argv[1:3]
bridge = read_bridge(river)

# The beam: frame elements that carry their mass, supports, damping of the modes.
ops.wipe()
ops.model("basic", "-ndm", 2, "-ndf", 3)
ops.geomTransf("Linear", 1)
x = [0.0]
for span in bridge.spans_m:
    x += [x[-1] + span * (i + 1) / ELEMENTS for i in range(ELEMENTS)]
for number, at in enumerate(x):
    ops.node(number, at, 0.0)
for number in range(len(x) - 1):
    span = number // ELEMENTS
    # Area, E and I: only E I matters, and along its axis the beam is so stiff that the modes are those of bending.
    section = 1e6, 1e9, bridge.stiffness_N_m2[span] / 1e9
    ops.element("elasticBeamColumn", number, number, number + 1, *section, 1, "-mass", bridge.mass_kg_m[span], "-cMass")
for number, support in enumerate(bridge.supports):
    if support != "free":
        ops.fix(number * ELEMENTS, int(number == 0 or support == "fixed"), 1, int(support == "fixed"))
ops.eigen(MODES)
ops.modalDamping(bridge.damping_ratio)

# Every axle load at the nodes of the element on which it stands, as its shape functions share it.
times, stations, loads = read_forces(forces)
at_nodes = np.zeros((len(x), 2, len(times)))
for row, (places, values) in enumerate(zip(stations, loads, strict=True)):
    for place, load in zip(places, values, strict=True):
        if not 0.0 <= place < x[-1]:
            continue
        left = int(np.searchsorted(x, place, side="right")) - 1
        length = x[left + 1] - x[left]
        t = (place - x[left]) / length
        shares = 1 - 3 * t**2 + 2 * t**3, 3 * t**2 - 2 * t**3
        turns = length * t * (1 - t) ** 2, -length * t**2 * (1 - t)
        for node, share, turn in zip((left, left + 1), shares, turns, strict=True):
            at_nodes[node, :, row] -= share * load, turn * load
interval = times[1] - times[0]
for node in range(len(x)):
    for direction, values in enumerate(at_nodes[node]):
        if values.any():
            tag = 1 + 2 * node + direction
            ops.timeSeries("Path", tag, "-dt", interval, "-values", *values.tolist())
            ops.pattern("Plain", tag, tag)
            ops.load(node, 0.0, 1.0 - direction, float(direction))

ops.constraints("Plain")
ops.numberer("RCM")
ops.system("BandGeneral")
# Damping of modes is no part of the tangent: one step without iteration would follow it late.
ops.test("NormDispIncr", 1e-12, 50)
ops.algorithm("Newton")
ops.integrator("Newmark", 0.5, 0.25)
ops.analysis("Transient")
middles = [ELEMENTS * i + ELEMENTS // 2 for i in range(len(bridge.spans_m))]
most = np.zeros((len(middles), 2))
for _ in range(STEPS * (len(times) - 1)):
    if ops.analyze(1, interval / STEPS) != 0:
        raise SystemExit("OpenSees found no solution.")
    # An element on which an axle stands shows its end moment without what the load itself does: the other one is lower.
    now = [(min(ops.eleForce(n - 1)[5], -ops.eleForce(n)[2]), -ops.nodeDisp(n, 2)) for n in middles]
    most = np.maximum(most, now)

print("section_m,moment_kN_m,deflection_mm")
for at, (moment, deflection) in zip(bridge.middles_m, most, strict=True):
    print(f"{at:g},{moment / 1e3:.3f},{1e3 * deflection:.4f}")
