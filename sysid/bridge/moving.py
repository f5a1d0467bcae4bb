"""Forces that move over a bridge: what they do along influence lines, and how the modes of the bridge answer them.

Mode n with mass M, angular frequency w and damping ratio z has, under forces F_i at stations s_i, the amplitude q with

    q'' + 2 z w q' + w^2 q = p / M,    p = sum_i phi(s_i) F_i.

Forces are straight between samples and mode shapes are followed between them, so that constant forces leave no error
of the step.  A load effect is that of all forces along its influence line I, exact, and what inertia and damping of the
modes add to it (mode acceleration):

    E = sum_i I(s_i) F_i + sum_n e_n (q_n - p_n / (M_n w_n^2)),

with e_n the effect of a unit of mode n.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.signal import lfilter

from sysid.arrays import SamplesByAxlesBySets
from sysid.bridge.structure import Bridge, BridgeModes
from sysid.errors import DataRejectedError

#: Points of the quadrature of Gauss in a step.
_POINTS = 6
#: Deck and vehicle are iterated until forces change by less than this share of the mean static load, and how often.
TOLERANCE = 1e-3
MOST_ROUNDS = 40


class Crossing(NamedTuple):
    """How axles move over a bridge: `place_m` (T, na) of every axle from its start, every `interval_s`."""

    place_m: np.ndarray
    interval_s: float


@dataclass(frozen=True)
class DeckMotion:
    """Answer of the modes to moving forces: weights of forces at successive samples, and the shapes under axles.

    `weight` (T - 1, n, 3 na) of the forces at the start of the step before, at the start and at the end of a step, and
    `decay` (n,) of a step, complex; `shape` (T, na, n).
    """

    modes: BridgeModes
    weight: np.ndarray
    decay: np.ndarray
    shape: np.ndarray

    def amplitudes(self, force_N: SamplesByAxlesBySets) -> np.ndarray:
        """Amplitudes q (T, n, S) [m] under forces (T, na, S) [N], from rest."""
        count, axles, sets = force_N.shape
        after_none = np.zeros((count + 1, axles, sets))
        after_none[1:] = force_N
        # The forces of three successive samples lie one behind the other.
        push = np.matmul(self.weight, as_strided(after_none, (count - 1, 3 * axles, sets), after_none.strides))
        found = np.zeros((len(force_N), self.decay.size, force_N.shape[2]))
        for n, decay in enumerate(self.decay):
            found[1:, n] = lfilter([1.0], [1.0, -2.0 * decay.real, abs(decay) ** 2], push[:, n], axis=0)
        return found

    def under_axles(self, amplitude_m: np.ndarray) -> SamplesByAxlesBySets:
        """Deflection of the deck under every axle (T, na, S) [m], positive downward."""
        return np.asarray(np.matmul(self.shape, amplitude_m))


def deck_motion(modes: BridgeModes, crossing: Crossing) -> DeckMotion:
    """The modes' answer to axles that move as in a crossing.

    With lambda = -z w + i w_d, the amplitude is the imaginary part of y / w_d, where y' = lambda y + p / M.  Steps of y
    are y_k = d y_(k-1) + s_k, so that

        q_k = 2 Re(d) q_(k-1) - |d|^2 q_(k-2) + Im(s_k - d* s_(k-1)) / w_d.
    """
    place, h = crossing
    omega, ratio = modes.angular_frequency, modes.damping_ratio
    exponent = -ratio * omega + 1j * omega * np.sqrt(1.0 - ratio**2)
    point, weight = np.polynomial.legendre.leggauss(_POINTS)
    first, last = (np.zeros((len(place) - 1, place.shape[1], omega.size), complex) for _ in range(2))
    for share, part in zip(0.5 * (1.0 + point), 0.5 * weight, strict=True):
        shape = modes.shape.at(place[:-1] + share * (place[1:] - place[:-1]))
        answer = part * h * np.exp(exponent * h * (1.0 - share)) / modes.modal_mass_kg * shape
        first += (1.0 - share) * answer
        last += share * answer

    decay = np.exp(exponent * h)
    none = np.zeros_like(first[:1])
    # What a step takes over from the one before, with the forces at both ends of that.
    from_first, from_last = (np.concatenate([none, -decay.conj() * of[:-1]]) for of in (first, last))
    weight = np.concatenate([from_first, from_last + first, last], axis=1).imag / exponent.imag
    return DeckMotion(modes, np.ascontiguousarray(np.moveaxis(weight, 1, 2)), decay, modes.shape.at(place))


class Alike(NamedTuple):
    """What vehicles do that cross alike, their mean: where the rounds of others begin.

    `deck_m` (T, na, 1) deflections under the axles, `change_N` (T, na, 1) what they add to the axle loads, and
    `gain_N_m` how much a vehicle's axle loads change where its own deck takes the place of the mean.
    """

    deck_m: SamplesByAxlesBySets
    change_N: SamplesByAxlesBySets
    gain_N_m: float


class Coupled(NamedTuple):
    """Forces (T, na, S) [N] of vehicle and bridge together.

    `rolling_N` are the forces on a deck that does not move; `rounds` says how often forces and deck were computed.
    """

    force_N: SamplesByAxlesBySets
    rolling_N: SamplesByAxlesBySets
    rounds: int


#: Axle loads (T, na, S) [N] for a deflection of the road under every axle (T, na, S or 1) [m], positive downward.
Forces = Callable[[SamplesByAxlesBySets], SamplesByAxlesBySets]


def coupled(motion: DeckMotion, forces: Forces, static_N: float, alike: Alike | None = None) -> Coupled:
    """Vehicle and bridge as one system: forces and deck motion are computed in turn until neither changes.

    Each is integrated over the whole crossing with the other's last history.  The deck answers a force by an
    integral over the past, so that the rounds converge faster than any geometric series whatever the laws of the
    vehicle are (waveform relaxation; E. Lelarasmee, A. Ruehli, A. Sangiovanni-Vincentelli, IEEE Transactions on
    Computer-Aided Design 1, 1982), and what they converge to is the coupled solution.  They end when forces no longer
    change, or would no longer with the deck that answers them.

    Parameters
    ----------
    static_N : mean static axle load [N], for the tolerance.
    alike : of similar vehicles, to begin with; the solution is the same.  Where one round suffices, the deck adds to
        the axle loads what it adds to theirs, and the rigid deck is not driven over.

    Raises
    ------
    DataRejectedError
        If forces still change after :data:`MOST_ROUNDS` rounds.
    """
    rigid = np.zeros((*motion.shape.shape[:2], 1))
    deck, gain = (rigid, np.inf) if alike is None else (alike.deck_m, alike.gain_N_m)
    force = forces(deck)
    rolling = force if alike is None else None
    rounds, change = 1, np.inf
    while change > TOLERANCE * static_N:
        answer = motion.under_axles(motion.amplitudes(force))
        moved = float(np.abs(answer - deck).max(initial=0.0))
        if moved == 0.0 or gain * moved <= TOLERANCE * static_N:
            break
        if rounds == MOST_ROUNDS:
            raise DataRejectedError(
                f"Vehicle and bridge do not come to one motion: axle loads still change by {1e-3 * change:.3g} kN "
                f"after {MOST_ROUNDS} rounds; check mass and stiffness of the bridge."
            )
        new = forces(answer)
        change = float(np.abs(new - force).max(initial=0.0))
        # Later changes of the deck are shorter waves, which tires feel more.
        deck, force, rounds, gain = answer, new, rounds + 1, np.inf
    if rolling is None:
        rolling = force - alike.change_N if alike is not None and rounds == 1 else forces(rigid)
    return Coupled(force, rolling, rounds)


def alike(motion: DeckMotion, forces: Forces, found: Coupled) -> Alike:
    """The mean of some vehicles (S of them) and the deck, to begin the rounds of others with."""
    deck = motion.under_axles(motion.amplitudes(found.force_N))
    mean = deck.mean(axis=2, keepdims=True)
    moved = float(np.abs(deck - mean).max())
    change = float(np.abs(forces(mean) - found.force_N).max())
    gain = change / moved if moved > 0.0 else np.inf
    return Alike(mean, (found.force_N - found.rolling_N).mean(axis=2, keepdims=True), gain)


class EffectTimes(NamedTuple):
    """Instants at which load effects are looked at: the samples, and both sides of an axle at a section.

    `sample` (m,) is the sample before each instant and `share` (m,) how far it is on the way to the next; `lines` (m,
    E, na) are the influence lines under the axles.
    """

    sample: np.ndarray
    share: np.ndarray
    lines: np.ndarray

    def between(self, history: np.ndarray) -> np.ndarray:
        """A history (T, ...) at these instants, straight between samples."""
        found: np.ndarray = history[self.sample]
        between = np.flatnonzero(self.share)
        share = self.share[between].reshape((-1,) + (1,) * (history.ndim - 1))
        found[between] = (1.0 - share) * found[between] + share * history[self.sample[between] + 1]
        return found


def effect_times(bridge: Bridge, crossing: Crossing) -> EffectTimes:
    """Instants and influence lines of a crossing."""
    place = crossing.place_m
    number = np.arange(len(place), dtype=float)
    instants = [number]
    corners = {x for line in bridge.lines for x in (line.station_m, line.jump_m) if x is not None}
    for corner in corners:
        for axle in place.T:
            if np.any(np.diff(axle) <= 0.0) or not axle[0] < corner < axle[-1]:
                continue
            at = float(np.interp(corner, axle, number))
            instants.append(np.array([at - 1e-7, at + 1e-7]))
    instant = np.clip(np.sort(np.concatenate(instants)), 0.0, number[-1])
    sample = np.minimum(instant.astype(int), len(place) - 2)
    times = EffectTimes(sample, instant - sample, np.empty(0))
    there = times.between(place)
    return times._replace(lines=np.stack([line.curve.at(there) for line in bridge.lines], axis=1))


def static_effects(times: EffectTimes, force_N: SamplesByAxlesBySets) -> np.ndarray:
    """Load effects (E, m, S) of forces along the influence lines: (T, na, S), or (1, na, S) of constant ones [N].

    Effects of one instant lie together in memory.
    """
    force = force_N[0] if len(force_N) == 1 else times.between(force_N)
    return np.moveaxis(np.matmul(times.lines, force), 1, 0)


def dynamic_effects(times: EffectTimes, motion: DeckMotion, force_N: SamplesByAxlesBySets) -> np.ndarray:
    """Load effects (E, m, S) of moving forces (T, na, S) [N] with the motion of the bridge that answers them."""
    modes = motion.modes
    compliance = 1.0 / (modes.modal_mass_kg * modes.angular_frequency**2)
    at_rest = compliance[:, None] * np.matmul(np.swapaxes(motion.shape, 1, 2), force_N)
    beyond = times.between(motion.amplitudes(force_N) - at_rest)
    effects = static_effects(times, force_N)
    effects += np.moveaxis(np.matmul(modes.effects, beyond), 1, 0)
    return effects
