"""Continuous beams of Euler and Bernoulli: influence lines without error, and natural modes by Hermite elements.

Displacement w and loads are positive downward, bending moments M = -EI w'' positive in sagging, and shear forces are
V = dM/dx.  Under loads at nodes, cubic elements are exact, so that influence lines (by the theorem of Mueller-Breslau:
the shape of the beam with a unit kink, jump or load at the section) have no error of discretisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import PPoly
from scipy.linalg import cho_factor, cho_solve, eigh

from sysid.bridge.structure import Bridge, BridgeModes, Curve, EffectKind, InfluenceLine

Support = Literal["pinned", "fixed", "free"]
Side = Literal["left", "right"]
#: Elements in half a wave of the highest mode, and fewest in a span.  Frequencies of w = sin(x) have the relative error
#: (pi / e)^4 / 1440 with e elements in half a wave.
ELEMENTS_PER_HALF_WAVE = 12
FEWEST_ELEMENTS = 8


@dataclass(frozen=True)
class ContinuousBeam:
    """Spans one behind the other: lengths, bending stiffness EI [N m2] and mass [kg/m] (spans,), and supports.

    There is one more support than spans; an end may be free (a cantilever) or fixed.
    """

    span_m: Sequence[float]
    stiffness_N_m2: Sequence[float]
    mass_kg_m: Sequence[float]
    supports: Sequence[Support]

    def __post_init__(self) -> None:
        spans = len(self.span_m)
        if not spans or {len(self.stiffness_N_m2), len(self.mass_kg_m), len(self.supports) - 1} != {spans}:
            raise ValueError("A beam needs a stiffness and a mass for every span, and one support more than spans.")
        if "free" in self.supports[1:-1]:
            raise ValueError("Only the ends of a beam can be free.")
        standing = sum(s != "free" for s in self.supports)
        if standing < 2 and "fixed" not in self.supports:
            raise ValueError("A beam on one pinned support falls; fix that support or add another one.")

    @property
    def support_m(self) -> np.ndarray:
        """Stations of the supports (spans + 1,) [m]."""
        return np.concatenate([[0.0], np.cumsum(self.span_m)])

    def bridge(self, name: str, sections_m: Sequence[float], modes: int, damping_ratio: float | np.ndarray) -> Bridge:
        """The beam as a bridge with moment, shear and deflection at sections, and its first modes.

        Shear at an inner support is that on its right and that on its left.  Effects that are zero there by the
        supports (the moment at a pinned end, the deflection of a support) are left out.
        """
        mesh = _Mesh(self, sections_m, modes)
        found = [line for x in sections_m for line in self._lines(mesh, float(x))]
        count = min(modes, mesh.free.size)
        square, shapes = eigh(mesh.stiffness, mesh.mass, subset_by_index=[0, count - 1])
        omega = np.sqrt(square)
        whole = np.zeros((2 * mesh.x.size, count))
        whole[mesh.free] = shapes
        local = mesh.local(whole)
        # Inertia forces of a mode, m omega^2 phi, act along the influence line like any other load.
        effects = [omega**2 * mesh.mass_product(of_line, local) for _, of_line in found]
        return Bridge(
            name,
            float(mesh.x[-1]),
            tuple(line for line, _ in found),
            BridgeModes(
                omega / (2.0 * np.pi),
                np.broadcast_to(damping_ratio, count).copy(),
                np.ones(count),
                mesh.curve(local, columns=True),
                np.array(effects).reshape(len(found), count),
            ),
        )

    def _lines(self, mesh: _Mesh, x: float) -> list[tuple[InfluenceLine, np.ndarray]]:
        """Influence lines at a section, each with its values at the ends of every element."""
        supports = self.support_m
        at = np.flatnonzero(np.isclose(supports, x, rtol=0.0, atol=1e-9))
        support = None if at.size == 0 else self.supports[int(at[0])]
        last = bool(at.size and at[0] == len(supports) - 1)
        end = last or bool(at.size and at[0] == 0)
        shear: list[tuple[str, Side]] = [("shear", "left" if last else "right")]
        if support is not None and not end:
            shear = [("shear left of the support", "left"), ("shear right of the support", "right")]
        found: list[tuple[str, EffectKind, np.ndarray]] = []
        if not end or support == "fixed":
            found.append(("moment", "moment", mesh.moment_line(x)))
        if support != "free":
            found += [(word, "shear", mesh.shear_line(x, side)) for word, side in shear]
        if support in (None, "free"):
            found.append(("deflection", "deflection", mesh.deflection_line(x)))
        return [
            (InfluenceLine(f"{word} at {x:.6g} m", kind, mesh.curve(local), x, x if kind == "shear" else None), local)
            for word, kind, local in found
        ]


class _Mesh:
    """Hermite elements of a beam with nodes at all supports and sections; degrees of freedom w and w' per node."""

    def __init__(self, beam: ContinuousBeam, sections_m: Sequence[float], modes: int):
        supports = beam.support_m
        size = supports[-1] / (ELEMENTS_PER_HALF_WAVE * max(modes, 1))
        pieces = [
            np.linspace(a, b, max(FEWEST_ELEMENTS, int(np.ceil((b - a) / size))) + 1) for a, b in pairwise(supports)
        ]
        nodes = np.unique(np.concatenate([*pieces, np.asarray(sections_m, float)]))
        # A section next to a node moves it: elements of no length have no stiffness.
        kept = np.concatenate([supports, np.asarray(sections_m, float)])
        near = np.abs(nodes[:, None] - kept).min(axis=1)
        close = np.diff(nodes) < 1e-3 * size
        drop = np.zeros(nodes.size, bool)
        drop[:-1] |= close & (near[:-1] > 0.0)
        drop[1:] |= close & (near[1:] > 0.0)
        self.x = nodes[~drop]
        self.h = np.diff(self.x)
        span = np.clip(np.searchsorted(supports, 0.5 * (self.x[1:] + self.x[:-1])) - 1, 0, len(beam.span_m) - 1)
        self._k = _element_stiffness(self.h) * np.asarray(beam.stiffness_N_m2, float)[span, None, None]
        self._m = _element_mass(self.h) * np.asarray(beam.mass_kg_m, float)[span, None, None]
        held = []
        for station, support in zip(supports, beam.supports, strict=True):
            node = int(np.argmin(np.abs(self.x - station)))
            held += {"pinned": [2 * node], "fixed": [2 * node, 2 * node + 1], "free": []}[support]
        self.free = np.setdiff1d(np.arange(2 * self.x.size), held)
        self.stiffness, self.mass = (self._assembled(e) for e in (self._k, self._m))

    def _assembled(self, elements: np.ndarray) -> np.ndarray:
        whole = np.zeros((2 * self.x.size,) * 2)
        for e, matrix in enumerate(elements):
            whole[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += matrix
        return np.asarray(whole[np.ix_(self.free, self.free)])

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        factor: tuple[np.ndarray, bool] = cho_factor(self.stiffness)
        return factor

    def _solved(self, load: np.ndarray) -> np.ndarray:
        """Displacements (dofs, 1) under loads at all degrees of freedom."""
        whole = np.zeros((load.size, 1))
        whole[self.free, 0] = cho_solve(self._factor, load[self.free])
        return whole

    def local(self, whole: np.ndarray) -> np.ndarray:
        """Values at the ends of every element (elements, 4, n) of columns (dofs, n)."""
        first = 2 * np.arange(self.h.size)
        return np.stack([whole[first + k] for k in range(4)], axis=1)

    def mass_product(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Integrals of m a b over the beam for a (elements, 4, 1) and n columns b (elements, 4, n)."""
        return np.asarray(np.einsum("eik,eij,ejn->n", one, self._m, other))

    def curve(self, local: np.ndarray, columns: bool = False) -> Curve:
        """The cubic curves through values at the ends of elements (elements, 4, n); one curve unless of columns."""
        w1, r1, w2, r2 = (local[:, k] for k in range(4))
        h = self.h[:, None]
        square = (3.0 * (w2 - w1) - h * (2.0 * r1 + r2)) / h**2
        cube = (2.0 * (w1 - w2) + h * (r1 + r2)) / h**3
        pieces = np.stack([cube, square, r1, w1])
        return Curve(PPoly(pieces if columns else pieces[..., 0], self.x))

    def _node(self, x: float) -> int:
        return int(np.argmin(np.abs(self.x - x)))

    def _broken(self, x: float, side: Side, dof: int, step: float) -> np.ndarray:
        """The shape of the beam whose element on a side of a section has a value of its own there, `step` more."""
        node = self._node(x)
        if node == 0 or (side == "right" and node < self.x.size - 1):
            element, place = node, dof
        else:
            element, place, step = node - 1, 2 + dof, -step
        jump = np.zeros(4)
        jump[place] = step
        load = np.zeros(2 * self.x.size)
        load[2 * element : 2 * element + 4] = -self._k[element] @ jump
        local = self.local(self._solved(load))
        local[element, :, 0] += jump
        return local

    def moment_line(self, x: float) -> np.ndarray:
        """Sagging moment at a section: the slope falls by one there."""
        return self._broken(x, "right", 1, -1.0)

    def shear_line(self, x: float, side: Side) -> np.ndarray:
        """Shear force at a section, on a side of a support: the deflection rises by one there."""
        return self._broken(x, side, 0, 1.0)

    def deflection_line(self, x: float) -> np.ndarray:
        """Deflection at a section under a unit load, which by Maxwell is that elsewhere under one at the section."""
        load = np.zeros(2 * self.x.size)
        load[2 * self._node(x)] = 1.0
        return self.local(self._solved(load))


def _element_stiffness(h: np.ndarray) -> np.ndarray:
    """Stiffness (elements, 4, 4) over EI of elements of length h."""
    a, b, c = 12.0 / h**3, 6.0 / h**2, 4.0 / h
    rows = [[a, b, -a, b], [b, c, -b, 0.5 * c], [-a, -b, a, -b], [b, 0.5 * c, -b, c]]
    return np.moveaxis(np.array(rows), -1, 0)


def _element_mass(h: np.ndarray) -> np.ndarray:
    """Consistent mass (elements, 4, 4) over m of elements of length h."""
    a, b, c, d, e, f = 156.0 * h, 22.0 * h**2, 54.0 * h, 13.0 * h**2, 4.0 * h**3, 3.0 * h**3
    rows = [[a, b, c, -d], [b, e, d, -f], [c, d, a, -b], [-d, -f, -b, e]]
    return np.moveaxis(np.array(rows), -1, 0) / 420.0
