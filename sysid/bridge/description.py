"""From a described bridge to its influence lines and modes."""

from __future__ import annotations

import numpy as np

from sysid.bridge.beam import ContinuousBeam
from sysid.bridge.structure import Bridge, BridgeModes, InfluenceLine, straight_pieces
from sysid.campaign.bridges import BridgeDescription, GivenModes

#: Points of a given influence line at which the product with a mode shape is integrated.
_POINTS = 2001


def made_bridge(description: BridgeDescription) -> Bridge:
    """The bridge of a description.

    What a unit of a given mode n does to a load effect follows from its influence line I: inertia forces
    m w_n^2 phi_n act along it, e_n = w_n^2 int m phi_n I ds, with the mass m per length.  Without influence lines the
    effects are the deflections at the stations of the shapes.
    """
    if description.span_m:
        beam = ContinuousBeam(
            description.span_m, description.stiffness_N_m2, description.mass_kg_m, description.supports
        )
        sections = description.sections_m
        wanted = _usual_sections(beam.support_m) if sections is None else np.unique(sections)
        return beam.bridge(description.name, wanted.tolist(), description.modes, np.array(description.damping_ratio))
    modes, lines = description.given_modes, _given_lines(description)
    ends = [line.curve.breaks_m[[0, -1]] for line in lines]
    if modes is not None:
        ends.append(modes.station_m[[0, -1]])
    length = float(max(e[1] for e in ends))
    if modes is None:
        return Bridge(description.name, length, lines)
    ratio = np.broadcast_to(np.array(description.damping_ratio), modes.frequency_hz.shape)
    shape = straight_pieces(modes.station_m, modes.shape)
    if lines:
        effects = _effects(lines, modes, description.mass_kg_m[0])
    else:
        lines, effects = _deflections(modes)
    return Bridge(
        description.name,
        length,
        lines,
        BridgeModes(modes.frequency_hz, ratio, modes.modal_mass_kg, shape, effects),
    )


def _usual_sections(support_m: np.ndarray) -> np.ndarray:
    return np.unique(np.concatenate([support_m, 0.5 * (support_m[1:] + support_m[:-1])]))


def _given_lines(description: BridgeDescription) -> tuple[InfluenceLine, ...]:
    found = []
    for line in description.lines:
        double = np.flatnonzero(np.diff(line.station_m) == 0.0)
        jump = float(line.station_m[double[0]]) if double.size else None
        found.append(InfluenceLine(line.name, line.kind, straight_pieces(line.station_m, line.values), None, jump))
    return tuple(found)


def _effects(lines: tuple[InfluenceLine, ...], modes: GivenModes, mass_kg_m: float) -> np.ndarray:
    square = (2.0 * np.pi * modes.frequency_hz) ** 2
    station = np.linspace(modes.station_m[0], modes.station_m[-1], _POINTS)
    shape = straight_pieces(modes.station_m, modes.shape).at(station)
    return np.stack(
        [square * np.trapezoid(mass_kg_m * shape * line.curve.at(station)[:, None], station, axis=0) for line in lines]
    )


def _deflections(modes: GivenModes) -> tuple[tuple[InfluenceLine, ...], np.ndarray]:
    """Deflections at the stations of the largest amplitudes, with what the modes alone say of their influence lines."""
    places = np.unique(np.abs(modes.shape).argmax(axis=0))
    compliance = 1.0 / (modes.modal_mass_kg * (2.0 * np.pi * modes.frequency_hz) ** 2)
    lines = []
    for place in places:
        x = float(modes.station_m[place])
        curve = straight_pieces(modes.station_m, modes.shape @ (compliance * modes.shape[place]))
        lines.append(InfluenceLine(f"deflection at {x:.6g} m", "deflection", curve, x))
    return tuple(lines), modes.shape[places]
