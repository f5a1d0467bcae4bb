"""Plank drops: height of the plank, drops of other axles, bodies let go, from how far the suspension is compressed.

A wheel on a plank of height h compresses its suspension by a share of h that follows from the stiffnesses of all axles
and tires: K u = k_t h at that wheel.  The step of the deflection between plank and road is measured to a millimetre.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.bookkeeping.drop_cases import clear_balances, load_case_complaints, odd_repeats
from sysid.bookkeeping.force_balance import RunSpectra, frame_rise
from sysid.bookkeeping.masses import stiffness_of
from sysid.campaign.records import Campaign, PlankDrop
from sysid.campaign.vehicle_records import Vehicle
from sysid.numbers import listing
from sysid.wording import shorten

#: Shares of the plank height: measured ones repeat within 0.03 (0.15 where friction holds), those
#: from the runs' stiffnesses agree within 0.1.
REPEATS, ONE_OF_TWO, AGREES = 0.08, 0.18, 0.12
#: Axles whose share is smaller tell nothing about the height.
TELLING = 0.2
HEIGHT_OFF = 1.35
#: Axles nearer than this on one body, with one kind of suspension, are taken to be alike: runs tell their sum best.
TANDEM_M = 2.0


def drop_complaints(campaign: Campaign, spectra: Sequence[RunSpectra]) -> list[str]:
    """Sentences about drops whose suspension is not compressed as it should be.

    Parameters
    ----------
    spectra
        Of the runs, for the stiffnesses of the axles; where there are none, drops are compared with each other alone.
    """
    shares = [(drop, compressed_share(drop)) for drop in campaign.plank_drops]
    known = [(drop, share) for drop, share in shares if share is not None]
    if not known:
        return []
    released = _released(known)
    if released:
        return [released]
    said: list[str] = []
    told = clear_balances(campaign, spectra)
    wrong = load_case_complaints(campaign, told)
    said += [] if wrong else odd_repeats(campaign, told)
    for case in dict.fromkeys(d.load_case for d, _ in known):
        if case in wrong:
            said.append(wrong[case])
            continue
        # An air spring is stiffer under load, so its suspension is compressed less.
        plank = [(d, s) for d, s in known if d.release == "plank" and d.load_case == case]
        said += _of_load_case(plank, _expected(campaign, spectra, case), campaign.vehicle)
    return list(dict.fromkeys(said))


def _of_load_case(
    plank: Sequence[tuple[PlankDrop, float]], expected: Sequence[float] | None, vehicle: Vehicle
) -> list[str]:
    odd = _odd_ones(plank, expected, vehicle)
    if expected is None:
        return odd
    exchanged = _exchanged(_medians(plank), expected, vehicle)
    if exchanged:
        return [*odd, *exchanged]
    return [*odd, *_heights(plank, expected, vehicle)]


def compressed_share(drop: PlankDrop) -> float | None:
    """Compression of the suspension before the fall over the plank height (0.075 m where there is none)."""
    channel = next((c for c in drop.log.channels if c.sensor.kind == "suspension_deflection"), None)
    if channel is None:
        return None
    good = np.isfinite(channel.value)
    time, value = channel.time_s[good], channel.value[good]
    if value.size < 100 or time[-1] < 1.5:
        return None
    before, after = value[time < 0.3], value[time > time[-1] - 0.7]
    if before.size < 5 or np.std(before) > 0.0015 or np.std(after) > 0.003:
        return None
    return float(np.median(after) - np.median(before)) / (drop.plank_height_m or 0.075)


def _released(known: Sequence[tuple[PlankDrop, float]]) -> str | None:
    """Bodies that were let go stretch the suspension before, planks compress it."""
    bodies = [s for d, s in known if d.release == "body"]
    planks = [s for d, s in known if d.release == "plank"]
    if len(bodies) > 1 and float(np.median(bodies)) > TELLING:
        return (
            'Drops with release = "body" begin with a compressed suspension, as on a plank: a lifted body '
            "stretches it before its release. Correct release, and give plank_height_m."
        )
    if len(planks) > 1 and float(np.median(planks)) < -TELLING:
        return (
            "Plank drops begin with a stretched suspension, as of a body that was lifted and let go: a wheel on a "
            'plank compresses it. Give release = "body", or check the sign of the deflection.'
        )
    return None


def _expected(campaign: Campaign, spectra: Sequence[RunSpectra], load_case: str) -> list[float] | None:
    """Share of the plank height by which each axle's suspension is compressed when it alone stands on the plank.

    From runs of the load case. If there are none, from those of another one, unless springs depend on the load.
    """
    cases = [load_case]
    if not any(axle.load_dependent for axle in campaign.vehicle.axles):
        cases += [name for name in campaign.load_cases if name != load_case]
    found = next((b for n in cases if (b := stiffness_of(spectra, campaign, n)) is not None), None)
    if found is None or found.unexplained > 0.2 or np.any(found.stiffness <= 0.0):
        return None
    return compressions(campaign.vehicle, _alike(campaign.vehicle, found.stiffness))


def _alike(vehicle: Vehicle, stiffness: np.ndarray) -> np.ndarray:
    result = stiffness.copy()
    groups: list[list[int]] = []
    for i, axle in enumerate(vehicle.axles):
        before = vehicle.axles[i - 1]
        near = i > 0 and axle.x_m - before.x_m < TANDEM_M
        if near and (axle.body, axle.suspension) == (before.body, before.suspension):
            groups[-1].append(i)
        else:
            groups.append([i])
    for group in groups:
        result[group] = stiffness[group].mean()
    return result


def compressions(vehicle: Vehicle, stiffness: np.ndarray) -> list[float]:
    """Compression of each axle's suspension over the height of a plank under its wheels alone, from static balance.

    Parameters
    ----------
    stiffness
        (axles,) of the suspensions [N/m].
    """
    count = len(vehicle.axles)
    frames = len(vehicle.bodies) + 1
    matrix = np.zeros((frames + count, frames + count))
    rises = []
    for i, axle in enumerate(vehicle.axles):
        row = np.zeros(frames + count)
        row[:frames] = frame_rise(vehicle, axle.body, axle.x_m)
        row[frames + i] = -1.0
        rises.append(row)
        matrix += stiffness[i] * np.outer(row, row)
        matrix[frames + i, frames + i] += axle.tire_stiffness_N_per_m
    shares = []
    for i, axle in enumerate(vehicle.axles):
        push = np.zeros(frames + count)
        push[frames + i] = axle.tire_stiffness_N_per_m
        shares.append(float(-rises[i] @ np.linalg.solve(matrix, push)))
    return shares


def _name(vehicle: Vehicle, axle: int) -> str:
    return f"'{shorten(vehicle.axles[axle].name)}'"


def _odd_ones(
    plank: Sequence[tuple[PlankDrop, float]], expected: Sequence[float] | None, vehicle: Vehicle
) -> list[str]:
    """Drops that differ from the others of their axle."""
    said = []
    by_axle: dict[int, list[tuple[PlankDrop, float]]] = {}
    for drop, share in plank:
        by_axle.setdefault(drop.axle, []).append((drop, share))
    medians = _medians(plank)
    for axle, shares in by_axle.items():
        for drop, share in shares:
            others = [s for d, s in shares if d is not drop]
            # Of two that differ, what the runs expect tells which one is odd.
            usual = float(np.median(others)) if len(others) > 1 else (expected[axle] if others and expected else None)
            if (
                usual is None
                or abs(share - usual) < (REPEATS if len(others) > 1 else ONE_OF_TWO)
                or (len(others) > 1 and np.ptp(others) > REPEATS)
            ):
                continue
            if len(others) == 1 and (abs(share - others[0]) < REPEATS or abs(others[0] - usual) > abs(share - usual)):
                continue
            near = [
                a for a, m in medians.items() if a != axle and abs(m - share) < min(REPEATS, abs(usual - share) / 2)
            ]
            hint = f", as {' or '.join(_name(vehicle, a) for a in near)} is" if near else ""
            said.append(
                f"{shorten(drop.log.file, 100)}: its suspension is compressed by {share:.2f} of the plank height, the "
                f"other drops of {_name(vehicle, axle)} by {usual:.2f}{hint}; check its axle and plank_height_m."
            )
    return said


def _exchanged(medians: dict[int, float], expected: Sequence[float], vehicle: Vehicle) -> list[str]:
    axles = sorted(medians)
    best: tuple[float, int, int] | None = None
    for k, i in enumerate(axles):
        for j in axles[k + 1 :]:
            now = np.hypot(medians[i] - expected[i], medians[j] - expected[j])
            swapped = np.hypot(medians[i] - expected[j], medians[j] - expected[i])
            apart = abs(expected[i] - expected[j])
            if apart > AGREES and now > AGREES and swapped < 0.5 * now and (best is None or now - swapped > best[0]):
                best = (float(now - swapped), i, j)
    if best is None:
        return []
    _, i, j = best
    return [
        f"The drops of {_name(vehicle, i)} and {_name(vehicle, j)} are probably exchanged: their suspensions are "
        f"compressed by {medians[i]:.2f} and {medians[j]:.2f} of the plank height, {expected[i]:.2f} and "
        f"{expected[j]:.2f} are expected from the bump runs. Correct the axles in tests.plank_drop."
    ]


def _heights(plank: Sequence[tuple[PlankDrop, float]], expected: Sequence[float], vehicle: Vehicle) -> list[str]:
    """Planks that are higher or lower than listed: drops of one listed height share a plank, others have their own."""
    heights = sorted({d.plank_height_m for d, _ in plank if d.plank_height_m is not None})
    said = (_height(h, [(d, s) for d, s in plank if d.plank_height_m == h], expected, vehicle) for h in heights)
    return [sentence for sentence in said if sentence is not None]


def _height(
    listed: float, plank: Sequence[tuple[PlankDrop, float]], expected: Sequence[float], vehicle: Vehicle
) -> str | None:
    medians = _medians(plank)
    telling = [axle for axle in sorted(medians) if expected[axle] > TELLING]
    if not telling:
        return None
    factor = float(np.median([medians[a] / expected[a] for a in telling]))
    apart = float(np.median([abs(medians[a] - expected[a]) for a in telling]))
    if 1.0 / HEIGHT_OFF < factor < HEIGHT_OFF or apart < AGREES:
        return None
    return (
        f"The suspensions of {listing([_name(vehicle, a) for a in telling])} are compressed before the drops as on a "
        f"plank {factor:.2f} times as high as listed: plank_height_m is {listed:g}, about {factor * listed:.3f} m is "
        "expected from the bump runs. Measure it."
    )


def _medians(plank: Sequence[tuple[PlankDrop, float]]) -> dict[int, float]:
    """Median share of every axle."""
    return {axle: float(np.median([s for d, s in plank if d.axle == axle])) for axle in {d.axle for d, _ in plank}}
