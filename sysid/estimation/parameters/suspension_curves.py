"""Corners of suspension curves that the campaign file declares: bump stops, hanger lash, force tables.

Every corner becomes a ramp of the suspension law (:class:`sysid.vehicle_model.suspension.Ramps`); its place or slope
may depend on parameters, so that stiffness and damping scale a declared curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sysid.arrays import RunsByAxles
from sysid.campaign.vehicle_records import Axle, ForceTable
from sysid.estimation.parameters.suspension_elements import NO_STOP_M
from sysid.vehicle_model.device_arrays import HostOrDevice, RunsByAxlesBySets, numpy_of
from sysid.vehicle_model.suspension import REFERENCE_RATE_M_S, Ramps

#: Compression [m] at which a rubber stop is three times as stiff as where it begins to act: an assumption.
STOP_LENGTH_M = 0.015
#: Compressions [m] at which the straight pieces of a stop meet its curve.
STOP_KNOTS_M = (0.0, 0.006, 0.014)
#: Place of a corner that is never reached, for axles with fewer corners than others.
_NEVER = NO_STOP_M


class TableCorners(NamedTuple):
    """A piecewise linear curve through rest, as multiples of the axle's stiffness or damping.

    `share` (R, na, 1) slope at rest; `at`, `side`, `change` (J, R, na, 1) position [m or m/s], which side of rest it
    stands on, and change of slope there.
    """

    share: np.ndarray
    at: np.ndarray
    side: np.ndarray
    change: np.ndarray


class SuspensionCurves(NamedTuple):
    """Declared curves of all axles in R passes; None where no axle has one.

    - `spring`, `damper`: tables;
    - `stops` (2, R, na, 1): extension at the rebound and at the jounce stop [m];
    - `lash` (R, na, 1): free travel of the hanger [m], zero where an axle has none.
    """

    spring: TableCorners | None = None
    damper: TableCorners | None = None
    stops: np.ndarray | None = None
    lash: np.ndarray | None = None


def suspension_curves(
    axles: Sequence[Axle], laws: Sequence[frozenset[str]], carried_N: RunsByAxles, reference_N: RunsByAxles
) -> SuspensionCurves:
    """Curves that the laws of the axles need.

    Parameters
    ----------
    laws : elements of every axle's suspension law.
    carried_N, reference_N : (R, na) load on each suspension in its pass and in the first load case.
    """
    passes = carried_N.shape[0]
    names = frozenset().union(*laws)
    pairs = list(zip(axles, laws, strict=True))
    never = np.full(len(axles), _NEVER)
    rebound, jounce, lash = never.copy(), -never, np.zeros(len(axles))
    for i, (axle, law) in enumerate(pairs):
        if "bump_stops" in law:
            rebound[i], jounce[i] = axle.rebound_travel_m or _NEVER, -(axle.jounce_travel_m or _NEVER)
        if "hanger_lash" in law:
            lash[i] = axle.hanger_lash_m or 0.0
    springs = [a.spring_table if "spring_table" in law else None for a, law in pairs]
    dampers = [a.damper_table if "damper_table" in law else None for a, law in pairs]
    rest = np.zeros_like(carried_N)
    for i, table in enumerate(springs):
        if table is not None:
            # A heavier load rests at the point of the table whose force is lower by the difference.
            rest[:, i] = _continued(reference_N[:, i] - carried_N[:, i], table.force_N, table.position)
    return SuspensionCurves(
        spring=_corners(springs, rest, None) if "spring_table" in names else None,
        damper=_corners(dampers, np.zeros_like(rest), REFERENCE_RATE_M_S) if "damper_table" in names else None,
        stops=np.tile(np.stack([rebound, jounce])[:, None, :, None], (1, passes, 1, 1))
        if "bump_stops" in names
        else None,
        lash=np.tile(lash[:, None], (passes, 1, 1)) if "hanger_lash" in names else None,
    )


def _continued(at: np.ndarray, x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray) -> np.ndarray:
    """Values (n,) of the straight pieces through points, beyond them with the slope of the outermost piece."""
    value, xs, ys = np.interp(at, x, y), np.asarray(x), np.asarray(y)
    for first, second, beyond in ((0, 1, at < xs[0]), (-1, -2, at > xs[-1])):
        width = xs[first] - xs[second]
        slope = (ys[first] - ys[second]) / width if width else 0.0
        value = np.where(beyond, ys[first] + slope * (at - xs[first]), value)
    return np.asarray(value)


def _corners(tables: list[ForceTable | None], rest: np.ndarray, secant_at: float | None) -> TableCorners:
    """Corners of all tables seen from where each pass rests (R, na); slopes as multiples of the one at zero.

    With `secant_at` they are multiples of the mean secant at +- that position instead.
    """
    count = max(1, *(len(t.position) - 2 for t in tables if t is not None))
    at = np.full((count, *rest.shape), _NEVER)
    change, share = np.zeros_like(at), np.ones_like(rest)
    for i, table in enumerate(tables):
        if table is None:
            continue
        x, force = np.array(table.position), np.array(table.force_N)
        slopes = np.diff(force) / np.diff(x)
        if secant_at is None:
            unit = slopes[np.searchsorted(x[1:-1], 0.0, side="right")]
        else:
            unit = np.diff(_continued(np.array([-secant_at, secant_at]), x, force))[0] / (2.0 * secant_at)
        unit = max(float(unit), 1e-9 * float(slopes.max()))
        share[:, i] = slopes[np.searchsorted(x[1:-1], rest[:, i], side="right")] / unit
        at[: x.size - 2, :, i] = x[1:-1, None] - rest[:, i]
        change[: x.size - 2, :, i] = (np.diff(slopes) / unit)[:, None]
    return TableCorners(share[..., None], at[..., None], np.where(at > 0.0, 1.0, -1.0)[..., None], change[..., None])


def table_ramps(corners: TableCorners, slope: RunsByAxlesBySets) -> Ramps:
    """Ramps of a table for stiffness or damping `slope` (R, na, S); its slope at rest is `corners.share * slope`."""
    shape, xp = (*corners.at.shape[:-1], slope.shape[-1]), numpy_of(slope)
    return Ramps(
        xp.broadcast_to(corners.at, shape),
        corners.side * corners.change * slope,
        xp.broadcast_to(corners.side, shape),
    )


def joined_stops(declared: HostOrDevice | None, jounce: RunsByAxlesBySets, rebound: RunsByAxlesBySets) -> HostOrDevice:
    """Extension at the rebound and at the jounce stop (2, R, na, S) [m], of declared and of estimated travels.

    Parameters
    ----------
    declared : (2, R, na, 1) extension at declared stops [m], None without any.
    jounce, rebound : (R, na, S) estimated travels [m], never reached where none is estimated.
    """
    xp = numpy_of(jounce, rebound)
    reached = [rebound, -jounce]
    if declared is not None:
        reached = [xp.minimum(declared[0], rebound), xp.maximum(declared[1], -jounce)]
    joined: HostOrDevice = xp.stack(reached)
    return joined


def stop_ramps(stops: HostOrDevice, stiffness: RunsByAxlesBySets) -> Ramps:
    """Ramps of rubber stops, F = k d (1 + d / l) at a travel d beyond the free one, as straight pieces.

    The pieces meet the curve at :data:`STOP_KNOTS_M`. Beyond the last of them, the force continues with the slope of
    the curve there.

    Parameters
    ----------
    stops : (2, R, na, 1 or S) extension at the rebound and at the jounce stop [m].
    stiffness : (R, na, S) k, where the stops begin to act [N/m].
    """
    knots = np.array(STOP_KNOTS_M)
    curve = knots * (1.0 + knots / STOP_LENGTH_M)
    slopes = np.append(np.diff(curve) / np.diff(knots), 1.0 + 2.0 * knots[-1] / STOP_LENGTH_M)
    side = np.array([1.0, -1.0])[:, None, None, None]
    shape, xp = (2, *stiffness.shape), numpy_of(stops, stiffness)
    return joined_ramps(
        [
            Ramps(
                xp.broadcast_to(stops + side * knot, shape),
                xp.broadcast_to(change * stiffness, shape),
                xp.broadcast_to(side, shape),
            )
            for knot, change in zip(knots, np.diff(slopes, prepend=0.0), strict=True)
        ]
    )


def lash_ramps(lash: np.ndarray, stiffness: RunsByAxlesBySets, carried: np.ndarray) -> Ramps:
    """Ramps of the hanger lash: from zero load of the spring, its force is zero until its hanger has moved `lash`.

    Parameters
    ----------
    lash, carried : (R, na, 1) free travel [m], zero for none, and static load on the spring [N].
    stiffness : (R, na, S) of the spring [N/m].
    """
    xp = numpy_of(stiffness)
    slack = xp.broadcast_to(carried / stiffness, stiffness.shape)
    slope = xp.where(lash > 0.0, stiffness, 0.0)
    at = xp.stack([slack, slack + lash])
    return Ramps(at, xp.stack([-slope, slope]), xp.ones_like(at))


def helper_ramps(
    helper: RunsByAxlesBySets, travel: RunsByAxlesBySets, stiffness: RunsByAxlesBySets, further: np.ndarray
) -> tuple[RunsByAxlesBySets, Ramps]:
    """Slope at rest (R, na, S) of a spring with helper leaves, and the ramp where they begin to act.

    At rest in the first load case the main leaves act alone. A load that is larger by dL compresses them by dL / k, and
    beyond the travel d both by (dL - k d) / (k + k_h): there the ramp takes the helper leaves away in rebound.

    Parameters
    ----------
    helper, travel : (R, na, S) k_h [N/m] and d [m]; stiffness : (R, na, S) k of the main leaves [N/m].
    further : (R, na, 1) dL, load on the spring over that in the first load case [N].
    """
    xp = numpy_of(stiffness, helper, travel)
    beyond = further - stiffness * travel
    acts = beyond > 0.0
    at = xp.where(acts, beyond / (stiffness + helper), beyond / stiffness)
    side = xp.where(acts, 1.0, -1.0)
    slope = xp.where(acts, stiffness + helper, stiffness)
    return slope, Ramps(at[None], (-side * helper)[None], side[None])


def joined_ramps(parts: list[Ramps]) -> Ramps:
    """All ramps of one or more parts."""
    return Ramps(*(numpy_of(*arrays).concatenate(arrays) for arrays in zip(*parts, strict=True)))
