"""The most likely laws of the suspensions: what the motion of the axles leaves to the bodies' balance.

The road, and so the motion z of the axles, is unknown: it has a flat prior and is integrated out. What is left of the
readings is then the balance e (:mod:`sysid.balance.equations`), normal at every frequency (Whittle) with

    S = A C A^H + R,      -log L = sum_omega log |S| - 2 log |det A_u| + e^H S^-1 e,

A = [A_u A_z] the balance by displacements of bodies and axles, C the noise of these, and R the covariance of forces
that no law explains, in bands of frequencies of every record. The second term is the Jacobian of the bodies' motion
given that of the axles. With it and A C A^H, errors of deflections do not pull k and c towards zero. R is estimated
beside the laws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.balance.equations import (
    Balanced,
    Block,
    balanced,
    horizontal_forces,
    pushed,
    shape_bases,
    suspension_forces,
)
from sysid.balance.laws import DAMPING, SATURATION, SLIP, SLIP_M, SOFTNESS, STIFFNESS, Shapes, Unknown
from sysid.balance.motion import stretching

#: Rounds of the search, the first ones for linear springs and dampers alone; shapes, horizontal forces and unexplained
#: ones are renewed in each.
_ROUNDS, LINEAR = 40, 5
#: A search ends where no unknown moves by more than this share of its standard deviation.
_CLOSE = 0.05
#: Largest step of a logarithm, and of a departure in prior standard deviations.
_STEP = 0.5
#: Updates of the unexplained forces in a round; they keep this share of the largest of a band.
_UPDATES, _FLOOR = 6, 1e-7


@dataclass(frozen=True)
class Found:
    """End of a search: `values` (p,) of the laws, and their `covariance` with that of all others, laws first.

    `others` (m + 7 na + g,) are masses, horizontal forces, departures and gains in prior standard deviations.
    """

    values: np.ndarray
    others: np.ndarray
    covariance: np.ndarray
    rounds: int
    converged: bool


def shapes_at(unknowns: Sequence[Unknown], values: np.ndarray, axles: int) -> Shapes:
    """Nonlinear numbers at values (p,) of the unknowns."""
    of = {(u.quantity, u.axle): (u.unit, float(v)) for u, v in zip(unknowns, values, strict=True)}
    saturation = np.array([of.get((SATURATION, i), (1.0, 0.0))[1] for i in range(axles)])
    delay = np.zeros(axles)
    for i in range(axles):
        if (DAMPING, i) in of and (SOFTNESS, i) in of:
            unit, logarithm = of[DAMPING, i]
            delay[i] = of[SOFTNESS, i][1] * unit * np.exp(logarithm)
    unit, logarithm = of.get((SLIP, None), (SLIP_M, 0.0))
    return Shapes(saturation, delay, float(unit * np.exp(logarithm)))


def search(blocks: Sequence[Block], unknowns: Sequence[Unknown], considered: np.ndarray, most: int = _ROUNDS) -> Found:
    """Search from the first values of all unknowns.

    Parameters
    ----------
    blocks, unknowns
        Equations, whose unexplained forces are filled in, and numbers of the laws.
    considered
        (m + 7 na + g,) whether one of the others stays as declared: its tolerance widens the intervals and is not
        estimated (S. F. Schmidt's consider parameters, 1966), since what laws leave would move it.
    most
        Rounds after which it ends without having converged.
    """
    others = considered.size
    count = len(unknowns)
    values, beside = np.zeros(count), np.zeros(others)
    sd = np.array([*(u.sd for u in unknowns), *np.ones(others)])
    limit = np.array([_STEP if u.quantity in (STIFFNESS, DAMPING, SLIP) else u.sd for u in unknowns])
    linear = np.array([u.quantity in (STIFFNESS, DAMPING) for u in unknowns])
    converged, rounds, moved = False, 0, np.inf
    covariance, information = np.eye(sd.size), np.eye(sd.size)
    for rounds in range(1, most + 1):
        horizontal = _renewed(blocks, unknowns, values)
        # Far from the end, departures would explain what wrong springs leave.
        free = np.concatenate([linear | (rounds > LINEAR), ~considered & (rounds > LINEAR)])
        now = [balanced(b, unknowns, values, h, beside) for b, h in zip(blocks, horizontal, strict=True)]
        _explain(blocks, now, first=rounds == 1)
        # The first rounds need nothing of what does not move.
        needed = free if rounds <= LINEAR else np.ones_like(free)
        information, score = _information(blocks, now, np.concatenate([values, beside]), sd, count, needed)
        covariance = np.zeros_like(information)
        covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
        step = -covariance @ score
        step[:count] *= min(1.0, float(np.min(limit / np.maximum(np.abs(step[:count]), 1e-12))))
        values, beside = values + step[:count], beside + step[count:]
        moved = float(np.max(np.abs(step[:count][linear]) / np.sqrt(np.diag(covariance))[:count][linear]))
        if rounds > LINEAR + 2 and moved < _CLOSE:
            converged = True
            break
    # With those that stay as declared goes what the others would do.
    carried = covariance @ information[:, count:][:, considered]
    carried[count + np.flatnonzero(considered), np.arange(considered.sum())] = -1.0
    return Found(values, beside, covariance + carried @ carried.T, rounds, converged)


def _renewed(blocks: Sequence[Block], unknowns: Sequence[Unknown], values: np.ndarray) -> list[np.ndarray]:
    """Shapes of laws and horizontal forces at the values; returns what the latter add to the balances."""
    beside = []
    for block in blocks:
        shapes = shapes_at(unknowns, values, len(block.vehicle.axles))
        shape_bases(block, shapes)
        forces = suspension_forces(block, unknowns, values, shapes)
        beside.append(pushed(block, horizontal_forces(block, forces)))
    return beside


def _explain(blocks: Sequence[Block], now: Sequence[Balanced], first: bool) -> None:
    """Update the covariances of unexplained forces: a few steps of expectation and maximisation."""
    for block, found in zip(blocks, now, strict=True):
        left = found.left.T
        kept = []
        for k, (a, b) in enumerate(block.bands):
            e, noise = left[a:b], found.noise[a:b]
            sample = np.mean(e[:, :, None] * np.conj(e[:, None, :]), axis=0).real
            cover = sample if first else block.unexplained[k]
            for _ in range(0 if first else _UPDATES):
                precision = np.linalg.inv(noise + cover)
                r = (precision @ e[:, :, None])[:, :, 0]
                change = np.mean(r[:, :, None] * np.conj(r[:, None, :]) - precision, axis=0).real
                cover = cover + cover @ change @ cover
            cover = 0.5 * (cover + cover.T)
            size, axes = np.linalg.eigh(cover)
            kept.append((axes * np.maximum(size, _FLOOR * size[-1])) @ axes.T)
        block.unexplained = np.array(kept)


def _information(
    blocks: Sequence[Block],
    now: Sequence[Balanced],
    point: np.ndarray,
    sd: np.ndarray,
    count: int,
    needed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Expected information (n, n) and score (n,) of -log posterior, that of the data about `needed` (n,) alone."""
    information, score = np.diag(1.0 / sd**2), point / sd**2
    for block, found in zip(blocks, now, strict=True):
        cover = np.repeat(block.unexplained, [b - a for a, b in block.bands], axis=0)
        root = np.linalg.inv(np.linalg.cholesky(found.noise + cover))
        weighed = root @ np.moveaxis(found.by[needed], 2, 0).swapaxes(1, 2)
        left = root @ found.left.T[:, :, None]
        # Real and imaginary parts under each other make one product of real matrices.
        flat = weighed.reshape(-1, int(needed.sum()))
        flat = np.concatenate([flat.real, flat.imag])
        information[np.ix_(needed, needed)] += 2.0 * flat.T @ flat
        score[needed] += 2.0 * np.sum(np.conj(weighed) * left, axis=(0, 1)).real
        score = score + _of_matrices(block, found, cover, root, left, sd.size, count)
    return information, score


def _of_matrices(
    block: Block, found: Balanced, cover: np.ndarray, root: np.ndarray, left: np.ndarray, size: int, count: int
) -> np.ndarray:
    """Score (size,) beside that of e: by laws and masses through A, and by gains through what readings share with e.

    d(-log L) = 2 Re tr[(C A^H (S^-1 - r r^H) - [A_u^-1; 0]) dA],    r = S^-1 e,
    and for a gain, whose column of e is T_s y_s, less its mean 2 Re T_s^H S^-1 (R A_u^-H K_s^H + T_s sigma_s^2).
    """
    nu = found.left.shape[0]
    upper = np.conj(np.swapaxes(root, 1, 2))
    precision, r = upper @ root, upper @ left
    inner = precision - r @ np.conj(np.swapaxes(r, 1, 2))
    turned = block.covariance @ np.conj(np.swapaxes(found.whole, 1, 2)) @ inner
    inverse = np.linalg.inv(found.whole[:, :, :nu])
    turned[:, :nu] -= inverse
    score = np.zeros(size)
    aboves = block.matrices.attachment[:, block.columns]
    of_axle = [turned @ above @ row for above, row in zip(aboves, stretching(block.matrices), strict=True)]
    for j, axle, stiffness in found.dynamic:
        score[j] += 2.0 * float((stiffness @ of_axle[axle]).real)
    pairs = turned[:, :nu].swapaxes(1, 2)
    still, moving = pairs.sum(axis=0).real, np.einsum("f,fab->ab", block.omega**2, pairs).real
    for j, change in enumerate(block.changes):
        if change is not None:
            score[count + j] = 2.0 * float(np.sum(still * change.tilt) - np.sum(moving * change.mass))
    sensors = found.of_readings
    seen = (1j * block.omega[:, None]) ** block.stretch.derivatives
    by_body = seen[:, :, None] * block.stretch.rows[:, :nu]
    common = cover @ np.conj(np.swapaxes(by_body @ inverse, 1, 2)) + sensors * block.stretch.noise**2
    mean = 2.0 * np.sum(np.conj(sensors) * (precision @ common), axis=(0, 1)).real
    score[size - block.of_gains.shape[1] :] = -mean @ block.of_gains
    return score
