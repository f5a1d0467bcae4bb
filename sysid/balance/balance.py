"""Stiffness and damping of all suspensions from the balance of forces on the bodies, without road, tires or contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.balance.equations import DEPARTURES, Block, MassChange, Passage, block_of
from sysid.balance.laws import DAMPING, STIFFNESS, Unknown, unknowns_of
from sysid.balance.motion import Stretch, smoothed, stretches_of, vertical_columns, with_noise_and_gains
from sysid.balance.search import Found, search
from sysid.campaign.records import Campaign, Log
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.display import Z90
from sysid.estimation.uncertainty.uncertain_masses import INERTIA, SCALE, UncertainMasses, uncertain_masses
from sysid.vehicle_model.assembly import PlanarMatrices, assemble
from sysid.vehicle_model.passes import HOLD_S

#: Part of a tolerance by which matrices are changed for their derivatives.
_PART = 0.5


def force_balance(campaign: Campaign):
    passages = [
        (run.log, Passage(run.log.file, run.load_case, run.expected_speed_m_s, HOLD_S[run.speed_held]))
        for run in campaign.bump_runs
    ]
    return solve(campaign, passages)


def solve(campaign, passages):
    vehicle = campaign.vehicle
    used = list(dict.fromkeys(p.load_case for _, p in passages))
    matrices = {name: assemble(vehicle, campaign.load_cases[name]) for name in used}
    masses = uncertain_masses(campaign)
    # The scale of all masses, k and c changes no signal: its tolerance is added at the end.
    masses = replace(masses, factors=tuple(f for f in masses.factors if f.quantity != SCALE))
    changes = mass_changes(masses, matrices)
    pairs = [(p, s) for log, p in passages for s in stretches_of(log, matrices[p.load_case])]
    stretches, gains = with_noise_and_gains([s for _, s in pairs])
    blocks = [
        block_of(p, s, smoothed(s, matrices[p.load_case]), matrices[p.load_case], changes[p.load_case], vehicle, gains)
        for (p, _), s in zip(pairs, stretches, strict=True)
    ]
    unknowns = unknowns_of(vehicle, campaign.load_cases, {n: m.carried_load for n, m in matrices.items()})
    considered = [f.quantity != INERTIA for f in masses.factors]
    considered += [False] * ((1 + DEPARTURES) * len(vehicle.axles) + len(gains.columns))
    found = search(blocks, unknowns, np.array(considered, bool))
    return blocks, unknowns, found, masses, gains


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
                )
            )
    return {name: tuple(c) for name, c in changes.items()}
