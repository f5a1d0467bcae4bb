"""Drops against runs: with the masses of its load case, a drop shows the stiffness that the runs show.

All drops of a load case together ring in the modes that its masses and the springs of the runs make; where another load
case, or a factor on the springs, explains them far better, something of both is wrong.  A single drop of an axle rings
at f, so that (2 pi f)^2 m is the stiffness of its suspension in series with the tire: the mass m of another load case
makes it several times too large or too small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from sysid.bookkeeping.drop_modes import Ringing, poles, ringings, unexplained
from sysid.bookkeeping.force_balance import Balance, RunSpectra
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
#: Of the rms of the ringings of an axle modes leave 0.04 to 0.23 with the right masses and springs on the simulated
#: trucks. Others are right that leave less than the first, and less than the listed ones by the second factor.
EXPLAINED, BETTER = 0.2, 2.5
#: A drop of which modes leave more than this, of its motion or that of its repeats if they move more, is odd where they
#: leave far less of its repeats.
ODD_REPEAT = 0.5
#: A drop that moves less than this multiple of its noise is compared with that: friction may hold it where it fell.
HELD = 3.0
#: Factors on the springs of the runs that are tried: twice the k in a drop is none of the same axle.
FACTORS = (0.25, 0.35, 0.5, 0.6, 1.7, 2.0, 2.8, 4.0)
_LONGEST_S, _PADDED = 4.0, 8
#: Balances of the frames that leave more than this tell no stiffness.
_UNCLEAR = 0.2
_FILES_NAMED, _FEWEST_AXLES = 3, 2


def clear_balances(campaign: Campaign, spectra: Sequence[RunSpectra]) -> dict[str, Balance]:
    """Stiffness and damping that the runs show, of load cases in which they do so clearly."""
    balances = {name: stiffness_of(spectra, campaign, name) for name in campaign.load_cases}
    return {n: b for n, b in balances.items() if b and b.unexplained < _UNCLEAR and np.all(b.stiffness > 0.0)}


def odd_repeats(campaign: Campaign, told: Mapping[str, Balance]) -> list[str]:
    """Sentences about drops that ring in other modes than the repeats beside them."""
    by_axle: dict[tuple[int, str], list[tuple[Ringing, float]]] = {}
    for ringing in ringings([d for d in campaign.plank_drops if d.release == "plank" and d.load_case in told]):
        case = ringing.drop.load_case
        modes = poles(campaign.vehicle, campaign.load_cases[case], told[case])
        # A suspension that friction holds after the fall shows noise, which is no mode.
        left = unexplained(ringing, modes) - ringing.deflection_m.size * ringing.noise_m**2
        by_axle.setdefault((ringing.drop.axle, case), []).append((ringing, max(left, 0.0)))
    said = []
    for (axle, case), found in by_axle.items():
        for ringing, left in found:
            others = [(r, rest) for r, rest in found if r is not ringing]
            if not others:
                continue
            # What friction lets creep is little of what the others show, but much of its own motion.
            held = ringing.deflection_m.size * (HELD * ringing.noise_m) ** 2
            usual = max(ringing.power, float(np.median([r.power for r, _ in others])), held, 1e-30)
            share = (left / usual) ** 0.5
            of_others = [(rest / max(r.power, 1e-30)) ** 0.5 for r, rest in others]
            if share > max(ODD_REPEAT, BETTER * max(of_others)):
                name = shorten(campaign.vehicle.axles[axle].name)
                said.append(
                    f"{shorten(ringing.drop.log.file, 100)} rings unlike the other drops of '{name}': the modes of the "
                    f"truck in load case '{shorten(case)}' leave {share:.0%} of its motion unexplained, and of those "
                    f"{float(np.median(of_others)):.0%}; check its axle and load_case, and what was different."
                )
    return said


def load_case_complaints(campaign: Campaign, told: Mapping[str, Balance]) -> dict[str, str]:
    """Sentences about drops that ring as with the masses of another load case, by the load case that is listed.

    Parameters
    ----------
    told
        By load case, what the runs show clearly.
    """
    vehicle, cases = campaign.vehicle, campaign.load_cases
    clear = {n: b.stiffness for n, b in told.items()}
    by_modes = {n: sentence for n in told if (sentence := _by_modes(campaign, n, told))}
    mass = {name: static_equilibrium(vehicle, cases[name]).tributary_mass_kg for name in clear}
    odd: dict[tuple[str, str], dict[int, tuple[float, list[str]]]] = {}
    for listed in clear.keys() - by_modes.keys():
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
    return by_modes | {listed: _sentence(campaign, listed, other, found) for (listed, other), found in odd.items()}


def _by_modes(campaign: Campaign, listed: str, told: Mapping[str, Balance]) -> str | None:
    """What explains all drops of a load case better than its masses and the springs of its runs, as a sentence."""
    vehicle, cases = campaign.vehicle, campaign.load_cases
    drops = [d for d in campaign.plank_drops if (d.load_case, d.release) == (listed, "plank")]
    by_axle: dict[int, list[Ringing]] = {}
    for ringing in ringings(drops):
        by_axle.setdefault(ringing.drop.axle, []).append(ringing)
    # Friction of one axle looks like softer springs, and may be most of the motion: most axles have to say the same.
    if len(by_axle) < _FEWEST_AXLES:
        return None

    def left(case: str, factor: float = 1.0, middle: Literal["lower", "higher"] = "higher") -> float:
        modes = poles(vehicle, cases[case], told[case], factor)
        return float(np.quantile([_share(of_axle, modes) for of_axle in by_axle.values()], 0.5, method=middle))

    as_listed = left(listed, middle="lower")
    others = {n: left(n) for n in told if n != listed}
    factors = {f: left(listed, f) for f in FACTORS}
    least = min([*others.values(), *factors.values()])
    if least > min(EXPLAINED, as_listed / BETTER):
        return None
    names = listing([f"'{shorten(vehicle.axles[a].name)}'" for a in sorted(by_axle)])
    rest = f"with those listed, the modes of the truck leave {as_listed:.0%} of their motion unexplained"
    other = next((n for n, share in others.items() if share == least), None)
    if other is not None:
        return (
            f"The drops of {names} are listed under the load case '{shorten(listed)}', but ring as with the masses of "
            f"'{shorten(other)}': {rest}, with those {least:.0%}. Correct load_case in tests.plank_drop."
        )
    factor = next(f for f, share in factors.items() if share == least)
    return (
        f"The drops of {names} ring as on springs {factor:g} times as stiff as those that the bump runs show with the "
        f"same masses, those of '{shorten(listed)}': {rest}, with such springs {least:.0%}. No axle has two "
        "stiffnesses under one load: check load_case in tests.plank_drop and tests.bump_run, and the masses."
    )


def _share(found: Sequence[Ringing], modes: np.ndarray) -> float:
    """What modes leave of ringings, as a share of their rms."""
    return float(np.sqrt(sum(unexplained(r, modes) for r in found) / max(sum(r.power for r in found), 1e-30)))


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
