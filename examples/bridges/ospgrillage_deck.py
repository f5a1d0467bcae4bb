"""The calibrated truck on a grillage by ospgrillage: wheels that move over a deck on simple supports.

    python examples/bridges/ospgrillage_deck.py river.toml output/models/laden/vehicle.csv

prints the largest moment at mid-span of every longitudinal member, and of all together.  Width and members of the deck
are assumed; put in yours.  Bending stiffness is spread evenly over four main members.
"""

from __future__ import annotations

import sys

import numpy as np
import ospgrillage as og
from files import read_axles, read_bridge

#: Width of the deck, overhang of its edges and distance of the wheels of an axle [m]; steps of the truck.
WIDTH_M, OVERHANG_M, TRACK_M, STEPS = 8.0, 1.0, 2.0, 100
#: Lines of members along (four main ones and two edges) and across the bridge: an odd number, one at mid-span.
ALONG, ACROSS = 6, 15

river, vehicle = sys.argv[1:3]
bridge = read_bridge(river)
if len(bridge.spans_m) != 1 or bridge.supports != ["pinned", "pinned"]:
    raise SystemExit("This example is a single span on simple supports.")
span = bridge.spans_m[0]

concrete = og.create_material(E=35e9, G=14.6e9, v=0.2, rho=2500.0)
inertia = bridge.stiffness_N_m2[0] / 35e9 / (ALONG - 2)


def member(width: float, z: float) -> og.members.GrillageMember:
    section = og.create_section(A=0.5, J=0.05, Iy=0.1, Iz=width * z, Ay=0.4, Az=0.4)
    return og.create_member(section=section, material=concrete)


deck = og.create_grillage(
    bridge_name="deck", long_dim=span, width=WIDTH_M, skew=0, num_long_grid=ALONG, num_trans_grid=ACROSS,
    edge_beam_dist=OVERHANG_M, mesh_type="Ortho",
)  # fmt: skip
for name in ("interior_main_beam", "exterior_main_beam_1", "exterior_main_beam_2"):
    deck.set_member(member(1.0, inertia), member=name)
deck.set_member(member(0.01, inertia), member="edge_beam")
for name in ("transverse_slab", "start_edge", "end_edge"):
    deck.set_member(member(1.0, 2e-3), member=name)
deck.create_osp_model(pyfile=False)

# The truck: two wheels per axle, axle 1 in front at the origin; it drives along the middle of the deck.
behind, load = read_axles(vehicle)
truck = og.create_compound_load(name="truck")
for x, axle in zip(behind, load, strict=True):
    for z in (-0.5 * TRACK_M, 0.5 * TRACK_M):
        wheel = og.create_load_vertex(x=-x, y=0, z=z, p=0.5 * axle)
        truck.add_load(og.create_load(loadtype="point", name="wheel", point1=wheel))
moving = og.create_moving_load(name="moving truck")
moving.set_path(
    og.create_moving_path(
        start_point=og.Point(0.0, 0, 0.5 * WIDTH_M),
        end_point=og.Point(span + max(behind), 0, 0.5 * WIDTH_M),
        increments=STEPS,
    )
)
moving.add_load(truck)
deck.add_load_case(moving)
deck.analyze()
results = deck.get_results(load_case="moving truck")

# Members that begin at mid-span, one per line along the bridge, from z = 0 on.
place = {tag: node["coordinate"] for tag, node in deck.Mesh_obj.node_spec.items()}
pairs, chosen = results.ele_nodes.isel(Loadcase=0), []
for element in results.Element.values:
    first, last = (place[int(node)] for node in pairs.sel(Element=element).values)
    if abs(first[0] - 0.5 * span) < 1e-6 < last[0] - first[0]:
        chosen.append((first[2], int(element)))
chosen.sort()
moment = results.forces.sel(Element=[element for _, element in chosen], Component="Mz_i").values
print("z_m,moment_kN_m")
for (z, _), most in zip(chosen, np.abs(moment).max(axis=0), strict=True):
    print(f"{z:g},{most / 1e3:.3f}")
print(f"all,{np.abs(moment.sum(axis=1)).max() / 1e3:.3f}")
