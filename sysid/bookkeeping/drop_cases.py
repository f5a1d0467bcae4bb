"""Drops against runs: with the masses of its load case, a drop shows the stiffness that the runs show.

A drop of an axle rings at f, so that (2 pi f)^2 m is the stiffness of its suspension in series with the tire. The mass
m of another load case makes it several times too large or too small; the balance of the frames in the runs says which.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.bookkeeping.force_balance import RunSpectra
from sysid.bookkeeping.masses import stiffness_of
from sysid.campaign.gaps import readings_at
from sysid.campaign.records import Campaign, PlankDrop
from sysid.campaign.statics import static_equilibrium
from sysid.numbers import listing
from sysid.wording import shorten

#: Motion of bodies [Hz]; a peak at the ends of the band is none.
BAND_HZ = (0.8, 3.8)
#: Stiffness of drops over that of the runs: neighbours and pitch make it 0.8 to 2.5 on the shipped trucks. Further off
#: than the first, and within the second with the masses of another load case, a drop is of that one.
OFF, RIGHT = 4.0, 2.5
_LONGEST_S, _PADDED = 4.0, 8
#: Balances of the frames that leave more than this tell no stiffness.
_UNCLEAR = 0.2
_FILES_NAMED = 3


def load_case_complaints(campaign: Campaign, spectra: Sequence[RunSpectra]) -> dict[str, str]:
    """Sentences about drops that ring as with the masses of another load case, by the load case that is listed."""
    vehicle, cases = campaign.vehicle, campaign.load_cases
    balances = {name: stiffness_of(spectra, campaign, name) for name in cases}
    clear = {
        n: b.stiffness for n, b in balances.items() if b and b.unexplained < _UNCLEAR and np.all(b.stiffness > 0.0)
    }
    mass = {name: static_equilibrium(vehicle, cases[name]).tributary_mass_kg for name in clear}
    odd: dict[tuple[str, str], dict[int, tuple[float, list[str]]]] = {}
    for listed in clear:
        for axle, record in enumerate(vehicle.axles):
            drops = [d for d in campaign.plank_drops if (d.axle, d.load_case, d.release) == (axle, listed, "plank")]
            rings = [f for d in drops if (f := _frequency_hz(d)) is not None]
            if not rings:
                continue
            series = (2.0 * np.pi * float(np.median(rings))) ** 2
            tire = record.tire_stiffness_N_per_m
            off = {n: abs(float(np.log(_behind_tire(series * mass[n][axle], tire) / clear[n][axle]))) for n in clear}
            best = min(off, key=lambda n: off[n])
            if off[listed] > np.log(OFF) and off[best] < np.log(RIGHT):
                found = odd.setdefault((listed, best), {})
                found[axle] = float(np.exp(off[listed])), [d.log.file for d in drops]
    return {listed: _sentence(campaign, listed, other, found) for (listed, other), found in odd.items()}


def _sentence(campaign: Campaign, listed: str, other: str, found: dict[int, tuple[float, list[str]]]) -> str:
    names = listing([f"'{shorten(campaign.vehicle.axles[a].name)}'" for a in sorted(found)])
    files = list(dict.fromkeys(f for _, of_axle in found.values() for f in of_axle))
    more = f" and {len(files) - _FILES_NAMED} more" if len(files) > _FILES_NAMED else ""
    factor = float(np.median([f for f, _ in found.values()]))
    return (
        f"The drops of {names} are listed under the load case '{shorten(listed)}', but ring as with the masses of "
        f"'{shorten(other)}': with those listed, their stiffness is {factor:.2g} times off that of the bump runs. "
        f"Correct load_case in tests.plank_drop ({', '.join(shorten(f, 60) for f in files[:_FILES_NAMED])}{more})."
    )


def _behind_tire(series: float, tire: float) -> float:
    """Stiffness of a spring that is `series` together with its tire; five times that at most."""
    return series * tire / max(tire - series, 0.2 * tire)


def _frequency_hz(drop: PlankDrop) -> float | None:
    """Frequency [Hz] at which the suspension rings after the fall; None beside a gap, or where nothing rings."""
    channel = next((c for c in drop.log.channels if c.sensor.kind == "suspension_deflection"), None)
    if channel is None or channel.time_s.size < 100:
        return None
    step = float(np.median(np.diff(channel.time_s)))
    time = np.arange(float(channel.time_s[0]), float(channel.time_s[-1]), max(step, 0.005))
    value = readings_at(channel, time, BAND_HZ[1])
    late = value[time > time[-1] - 0.7]
    if time.size < 100 or not np.isfinite(late).any() or not np.isfinite(value[:20]).any():
        return None
    away = value - np.nanmedian(late)
    plateau = float(np.nanmedian(away[time < time[0] + 0.3]))
    fallen = np.abs(away - plateau) > 0.3 * abs(plateau)
    if not fallen.any():
        return None
    begin = int(np.argmax(fallen))
    ringing = away[begin : begin + int(_LONGEST_S / float(time[1] - time[0]))]
    if ringing.size < 100 or not np.isfinite(ringing).all():
        return None
    frequency = np.fft.rfftfreq(_PADDED * ringing.size, float(time[1] - time[0]))
    # As velocity: what is left of the step weighs little.
    power = frequency * np.abs(np.fft.rfft(ringing, _PADDED * ringing.size))
    inside = np.flatnonzero((frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1]))
    best = int(np.argmax(power[inside]))
    return float(frequency[inside[best]]) if 0 < best < inside.size - 1 else None
