"""Whether drives move the suspensions enough, before their balance is solved: what to drive if they do not."""

from __future__ import annotations

import math

import numpy as np

from sysid.balance.equations import Block
from sysid.balance.laws import DAMPING, STIFFNESS
from sysid.balance.records import DETERMINED
from sysid.balance.search import LINEAR, search
from sysid.balance.solve import equations_of
from sysid.campaign.records import Campaign
from sysid.display import Z90
from sysid.numbers import listing
from sysid.road.roughness import CLASS_A_M3, REFERENCE_WAVE_NUMBER, class_of_density
from sysid.threads import one_blas_thread

#: Where axles follow the road, above the bodies and below wheel hop [Hz].
_FOLLOWS_HZ = (2.0, 4.5)
#: Fastest drive [km/h], and the density of the roughest road [m3], that are asked for: class D (assumptions).
_FASTEST_KM_H, _ROUGHEST_M3 = 90.0, 1024e-6


@one_blas_thread()
def smooth_roads(campaign: Campaign) -> list[str]:
    """A sentence on k and c that the drives of a campaign will not tell within a factor of 1.5, and what to drive.

    The intervals are those of the balance after its rounds with linear springs and dampers and one with all laws.
    Readings are noisy and friction does not grow with the road, so that an interval falls as motion grows: roughly as
    the square root of speed times roughness G_d(n_0).

    Parameters
    ----------
    campaign
        After the quality check.
    """
    if not campaign.road_drives:
        return []
    posed = equations_of(campaign)
    if isinstance(posed, str):
        return []
    drives = {drive.log.file for drive in campaign.road_drives}
    driven = [b for b in posed.blocks if b.passage.file in drives and b.passage.speed_m_s]
    found = search(posed.blocks, posed.unknowns, posed.considered, LINEAR + 1)
    sd = np.hypot(np.sqrt(np.diag(found.covariance)), campaign.vehicle.tolerances.axle_load_scale)
    enough = math.log(DETERMINED) / (2.0 * Z90)
    symbols = {STIFFNESS: "k", DAMPING: "c"}
    vague = {
        f"{symbols[u.quantity]} of axle {u.axle + 1}" + (f" ({u.load_case})" if u.load_case else ""): float(s) / enough
        for u, s in zip(posed.unknowns, sd, strict=False)
        if u.quantity in symbols and u.axle is not None and s > enough
    }
    if not vague or not driven:
        return []
    most = max(driven, key=lambda b: (b.passage.speed_m_s or 0.0) * _density(b))
    return [f"The drives are too smooth to tell {listing(list(vague))}; {_remedy(most, max(vague.values()))}."]


def _density(block: Block) -> float:
    """G_d(n_0) [m3] about, from the motion of the axles."""
    nu, step = block.columns.size, block.stretch.step_s
    hz = block.omega / (2.0 * np.pi)
    inside = (hz >= _FOLLOWS_HZ[0]) & (hz <= _FOLLOWS_HZ[1])
    motion = block.transform(block.motion.displacement[nu:])[:, inside]
    density = 2.0 * step * np.abs(motion) ** 2 * hz[inside] ** 2
    return float(np.mean(density)) / (REFERENCE_WAVE_NUMBER**2 * (block.passage.speed_m_s or 1.0))


def _remedy(block: Block, needed: float) -> str:
    """What to drive so that motion grows by the factor `needed`."""
    speed, density = 3.6 * (block.passage.speed_m_s or 0.0), _density(block)
    name = "smoother than class A" if density < 0.5 * CLASS_A_M3 else f"of class {class_of_density(density)}"
    here = f"the roughest road, {block.passage.file}, is {name}, at {speed:.0f} km/h"
    faster = 10.0 * math.ceil(speed * (needed**2 - 1.0) / 10.0)
    # The class whose centre is at least as rough as it must be.
    rougher = class_of_density(2.0 * density * needed**2)
    ways = [f"{faster:.0f} km/h faster"] if speed + faster <= _FASTEST_KM_H else []
    ways += [f"over a road of class {rougher}"] if density * needed**2 <= _ROUGHEST_M3 else []
    return f"{here}; drive {' or '.join(ways or ['over a bump as well'])}"
