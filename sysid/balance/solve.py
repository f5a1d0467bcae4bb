"""Stiffness and damping of all suspensions from the balance of forces on the bodies, without road or bump."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.balance.axle_loads import axle_loads, forces_of
from sysid.balance.equations import DEPARTURES, Block, MassChange, Passage, block_of
from sysid.balance.laws import DAMPING, FRICTION, SLIP, STIFFNESS, UNITS, Unknown, unknowns_of
from sysid.balance.motion import Gains, Stretch, smoothed, stretches_of, vertical_columns, with_noise_and_gains
from sysid.balance.records import BalancedRecord, BalanceEstimate, ForceBalance, LawEstimate
from sysid.balance.search import Found, search
from sysid.balance.tires import tires_of
from sysid.campaign.records import HOLD_S, Campaign, Log
from sysid.campaign.vehicle_records import Vehicle
from sysid.display import Z90
from sysid.estimation.uncertainty.uncertain_masses import INERTIA, SCALE, UncertainMasses, uncertain_masses
from sysid.threads import one_blas_thread
from sysid.vehicle_model.assembly import PlanarMatrices, assemble

#: Part of a tolerance by which matrices are changed for their derivatives.
_PART = 0.5
_SYMBOLS = {STIFFNESS: "k", DAMPING: "c"}


@one_blas_thread()
def balance_forces(campaign: Campaign) -> ForceBalance:
    """k, c and laws of all suspensions from logs of bump runs and road drives, whatever wheels rolled over.

    For every body, mass times acceleration and inertia times angular acceleration are the sum of the forces of its
    suspensions, functions of measured deflections and their rates: :mod:`sysid.balance.equations`, solved by
    :mod:`sysid.balance.search`. Intervals hold noise and gains of sensors, tolerances of masses, heights and scales,
    forces that no law explains, and doubts about the laws. Of road drives there are axle loads
    (:mod:`sysid.balance.axle_loads`), tires, speeds and roads (:mod:`sysid.balance.tires`), too.

    Parameters
    ----------
    campaign
        After the quality check, with the sensors of its logs.

    Returns
    -------
    ForceBalance
        Without estimates where vehicle or sensors do not allow a balance; `sentences` say why.
    """
    posed = equations_of(campaign)
    if isinstance(posed, str):
        return ForceBalance((), (), (), (posed,), False, 0)
    blocks, unknowns, gains = posed.blocks, posed.unknowns, posed.gains
    found = search(blocks, unknowns, posed.considered)
    balance = _result(campaign, blocks, unknowns, found, posed.files)
    driven = {drive.log.file for drive in campaign.road_drives}
    shared_gain = math.sqrt(float(np.mean(gains.covariance)))
    scale = campaign.vehicle.tolerances.axle_load_scale
    of_drives = [(b, forces_of(b, unknowns, found)) for b in blocks if b.passage.file in driven]
    loads = axle_loads(of_drives, unknowns, found, scale, shared_gain)
    tires, roads, said = tires_of(of_drives, found, scale)
    return replace(balance, loads=loads, tires=tires, roads=roads, sentences=(*balance.sentences, *said))


@dataclass(frozen=True)
class Equations:
    """The balances of all stretches, their unknowns, which of the others stay as declared, and all `files`."""

    blocks: list[Block]
    unknowns: list[Unknown]
    considered: np.ndarray
    gains: Gains
    files: list[str]


def equations_of(campaign: Campaign) -> Equations | str:
    """The balances of a campaign, or a sentence that says why there are none."""
    vehicle = campaign.vehicle
    refused = _refused(vehicle)
    if refused:
        return refused
    records = [
        (run.log, Passage(run.log.file, run.load_case, run.expected_speed_m_s, HOLD_S[run.speed_held]))
        for run in campaign.bump_runs
    ]
    records += [
        (drive.log, Passage(drive.log.file, drive.load_case, drive.speed_m_s, HOLD_S[drive.speed_held]))
        for drive in campaign.road_drives
    ]
    every = {p.load_case: assemble(vehicle, campaign.load_cases[p.load_case]) for _, p in records}
    pairs = [(p, s) for log, p in records for s in _told(log, p, every)]
    if not pairs:
        return (
            "No log has a stretch of 4 s with the motion of all frames and the deflections of all suspensions, so the "
            "balance of forces tells nothing; it needs a deflection (or the accelerations of axle and frame) at every "
            "axle and two accelerations, or one and a pitch rate, on every frame."
        )
    matrices = {p.load_case: every[p.load_case] for p, _ in pairs}
    masses = uncertain_masses(campaign)
    # The scale of all masses, k and c changes no signal: its tolerance is added at the end.
    masses = replace(masses, factors=tuple(f for f in masses.factors if f.quantity != SCALE))
    changes = mass_changes(masses, matrices)
    stretches, gains = with_noise_and_gains([s for _, s in pairs])
    blocks = [
        block_of(p, s, smoothed(s, matrices[p.load_case]), matrices[p.load_case], changes[p.load_case], vehicle, gains)
        for (p, _), s in zip(pairs, stretches, strict=True)
    ]
    unknowns = unknowns_of(vehicle, {n: m.carried_load for n, m in matrices.items()})
    considered = [f.quantity != INERTIA for f in masses.factors]
    considered += [False] * ((1 + DEPARTURES) * len(vehicle.axles) + len(gains.columns))
    return Equations(blocks, unknowns, np.array(considered, bool), gains, [p.file for _, p in records])


def _refused(vehicle: Vehicle) -> str:
    """Why a vehicle has no balance, or nothing."""
    if vehicle.groups:
        return "The balance of forces does not know axles on a common beam: it is left out."
    if vehicle.equalisers:
        return "The balance of forces does not know rockers between springs: it is left out."
    if any(body.bending is not None for body in vehicle.bodies):
        return "The balance of forces takes frames as rigid, and one is declared to bend: it is left out."
    return ""


def _told(log: Log, passage: Passage, matrices: Mapping[str, PlanarMatrices]) -> list[Stretch]:
    """Stretches of a log whose sensors tell all motions."""
    stretches = stretches_of(log, matrices[passage.load_case])
    return [s for s in stretches if np.linalg.matrix_rank(s.rows, tol=0.1) == s.rows.shape[1]]


def mass_changes(
    masses: UncertainMasses, matrices: Mapping[str, PlanarMatrices]
) -> dict[str, tuple[MassChange | None, ...]]:
    """Changes of matrices by one tolerance of every declared mass property, per load case; None where there is none."""
    changes: dict[str, list[MassChange | None]] = {name: [] for name in matrices}
    for j, factor in enumerate(masses.factors):
        moved = np.zeros(len(masses.factors))
        moved[j] = _PART * factor.sd
        vehicle, cases = masses.applied(moved)
        for name, here in matrices.items():
            if name not in factor.load_cases:
                changes[name].append(None)
                continue
            there, columns = assemble(vehicle, cases[name]), vertical_columns(here)
            square = np.ix_(columns, columns)
            changes[name].append(
                MassChange(
                    (there.mass - here.mass)[square] / _PART,
                    (there.tilt - here.tilt)[square] / _PART,
                    (there.attachment - here.attachment)[:, columns] / _PART,
                    (there.unsprung_mass - here.unsprung_mass) / _PART,
                    (there.static_load - here.static_load) / _PART,
                )
            )
    return {name: tuple(c) for name, c in changes.items()}


def _result(
    campaign: Campaign, blocks: Sequence[Block], unknowns: Sequence[Unknown], found: Found, files: Sequence[str]
) -> ForceBalance:
    scale = campaign.vehicle.tolerances.axle_load_scale
    sd = np.sqrt(np.diag(found.covariance))
    estimates, laws = [], []
    for u, value, error in zip(unknowns, found.values.tolist(), sd.tolist(), strict=False):
        if u.quantity in _SYMBOLS and u.axle is not None:
            best, log_sd = u.unit * math.exp(value), math.hypot(error, scale)
            name = f"{_SYMBOLS[u.quantity]}_{u.axle + 1}" + ("" if u.load_case is None else f"[{u.load_case}]")
            low, high = best * math.exp(-Z90 * log_sd), best * math.exp(Z90 * log_sd)
            unit = UNITS[u.quantity]
            estimates.append(BalanceEstimate(name, u.quantity, u.axle, u.load_case, unit, best, low, high, log_sd))
        elif u.quantity == SLIP:
            laws.append(
                LawEstimate(u.quantity, None, UNITS[SLIP], u.unit * math.exp(value), u.unit * math.exp(value) * error)
            )
        else:
            laws.append(LawEstimate(u.quantity, u.axle, UNITS[u.quantity], value, error))
    rubbing = any(law.quantity == FRICTION and abs(law.value) > 2.0 * law.sd for law in laws)
    records = _records(blocks)
    sentences = [f"{f} is no part of the balance: it has no stretch of 4 s that shows all motions." for f in files
                 if f not in {r.file for r in records}]  # fmt: skip
    vague = [e.name for e in estimates if not e.determined]
    if vague:
        sentences.append(
            f"The balance does not tell {', '.join(vague)} within a factor of 1.5: the suspensions move too little, or "
            "together. Rougher roads, or other speeds, show more."
        )
    if not found.converged:
        sentences.append("The balance has not converged: its values are not final.")
    return ForceBalance(
        tuple(estimates), tuple(law for law in laws if law.quantity != SLIP or rubbing), records, tuple(sentences),
        found.converged, found.rounds,
    )  # fmt: skip


def _records(blocks: Sequence[Block]) -> tuple[BalancedRecord, ...]:
    """Per log what is used, and the forces that remain over those of inertia."""
    rows: dict[str, list[tuple[float, np.ndarray, np.ndarray]]] = {}
    for block in blocks:
        columns = block.columns
        inertia = block.matrices.mass[np.ix_(columns, columns)] @ block.inertia[0]
        count = np.array([b - a for a, b in block.bands])
        left = np.einsum("b,buu->u", count, block.unexplained)
        seconds = block.stretch.count * block.stretch.step_s
        rows.setdefault(block.passage.file, []).append((seconds, left, np.sum(np.abs(inertia) ** 2, axis=1)))
    cases = {b.passage.file: b.passage.load_case for b in blocks}
    return tuple(
        BalancedRecord(
            file, cases[file], float(sum(s for s, _, _ in parts)),
            float(np.sqrt(np.mean(sum(e for _, e, _ in parts) / sum(i for _, _, i in parts)))),
        )
        for file, parts in rows.items()
    )  # fmt: skip
