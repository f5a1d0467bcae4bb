"""Analysis of one plank drop: from the log to stiffness and damping by three methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.campaign.gaps import readings_at
from sysid.campaign.records import Channel, PlankDrop
from sysid.campaign.statics import static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import DataRejectedError
from sysid.sdof.damping_choice import more_than_viscous, viscous_alone, without_sticking
from sysid.sdof.damping_law import fit_damping_law
from sysid.sdof.decay import PreparedRecord, prepare_record, reading_of, smooth_record
from sysid.sdof.drop_results import DampingLaw, DecayReading, DropAnalysis, DropEstimate, DropMethod
from sysid.sdof.equations import directive_damping
from sysid.sdof.estimates import AxleOnTire, estimate, estimate_by_law, unusable
from sysid.sdof.free_decay import FreeDecayFit, fit_free_decay
from sysid.sdof.second_drop import second_drop
from sysid.sdof.settings import DropSettings

_SIDE_DISAGREEMENT = 0.2  # relative difference of left and right that is worth a remark
_DECREMENT_DISAGREEMENT = 0.2  # relative difference of two methods that is worth a remark
_BLOCK_PERIODS = 0.6  # of the slowest body mode: holds a whole swing and little of the next
_CONTACT_LENGTH_RADII = 0.25  # half the footprint of a truck tire in tire radii, roughly


def analyse_drop(
    drop: PlankDrop, vehicle: Vehicle, load_case: LoadCase, settings: DropSettings | None = None
) -> DropAnalysis:
    """Estimate stiffness and damping of the axle under test from one plank drop.

    Methods ``paper`` (equations (1)-(3) on the picked peaks), ``corrected`` (the same reading, tire in series, tire
    damping and unsprung mass taken out exactly, see `invert_quarter_car`) and ``free_decay`` (that inversion on the
    body-mode eigenvalue of a fitted model).  All three take the axle for the only one under its body.  Where the record
    shows dry friction or quadratic damping (`fit_damping_law`), all three take the viscous part of it.  A record
    that holds a second drop is read up to there.

    Parameters
    ----------
    drop, vehicle, load_case
        Records of the campaign; m_bi = axle load - unsprung mass [kg] from the load case.
    settings
        Defaults of `DropSettings`.

    Returns
    -------
    DropAnalysis
        Estimates that the record does not support are `usable` False with NaN numbers and a note.

    Raises
    ------
    DataRejectedError
        If the log has no suspension deflection of the axle under test.
    CampaignError
        If the masses of the load case do not add up.
    """
    settings = settings or DropSettings()
    time, whole, remarks = _deflection(drop, vehicle)
    again = second_drop(time, whole, _BLOCK_PERIODS / settings.frequency_range_hz[0])
    deflection = np.where(time <= again, whole, np.nan)
    if np.isfinite(again):
        remarks.append(f"a second drop begins at {again:.2f} s, the record is read up to there")
    axle = axle_on_tire(drop.axle, vehicle, load_case)
    record, fit = _read(drop, vehicle, time, deflection, settings)
    mixture = fit_damping_law(record, from_release=drop.release == "body")
    neighbours = has_neighbours(vehicle)
    law = more_than_viscous(mixture, record, fit, neighbours=neighbours)
    if law is not None:
        record = without_sticking(_with_period(record, time, deflection, drop, settings, law), law)
    reading = reading_of(record)
    if law is not None and reading.usable:
        # Dry friction shifts the extrema, the more the smaller the swing: the fitted motion knows the period.
        period_se = float(np.sqrt(law.covariance[0, 0]))
        reading = replace(reading, damped_period=law.damped_period, damped_period_se=period_se)
    free_decay = np.full(time.size, np.nan)
    if fit.usable:
        inside = (time >= fit.window_s[0]) & (time <= fit.window_s[1])
        free_decay[inside] = np.interp(time[inside], fit.time_s, fit.model)
    kind = law.kind if law is not None else reading.damping_kind
    if kind == "unknown" and viscous_alone(mixture, record):
        kind = "viscous"
    elif law is None and kind != "viscous" and neighbours and mixture.usable:
        kind = "unknown"  # a decrement that changes, but two modes explain it as well
    note = fit.note
    if law is not None:
        free_decay, note = np.interp(time, law.time_s, law.model, left=np.nan, right=np.nan), ""
    period = reading.damped_period if reading.usable or law is None else law.damped_period
    return DropAnalysis(
        axle=drop.axle,
        load_case=load_case.name,
        file=drop.log.file,
        tributary_mass_kg=axle.mass,
        time_s=time,
        deflection_m=whole,
        filtered_m=np.where(time <= again, smooth_record(record, time), np.nan),
        release_time_s=record.release.time_s if record.release is not None else float("nan"),
        reading=reading,
        free_decay_m=free_decay,
        free_decay_note=note,
        estimates=tuple(
            replace(e, damping_kind=kind) for e in _estimates(axle, settings, drop.log.file, reading, fit, remarks)
        )
        if law is None
        else _estimates_by_law(axle, settings, drop.log.file, law, remarks),
        frequency_hz=1.0 / period,
        damping_ratio_directive=float(directive_damping(reading.log_decrement)),
        damping_kind=kind,
        law=law,
        second_drop_s=again if np.isfinite(again) else float("nan"),
    )


def has_neighbours(vehicle: Vehicle) -> bool:
    """Whether any body rests on more than one support, or more than one body is there: several body modes."""
    return len(vehicle.axles) > 1 or any(body.hitch_x_m is not None for body in vehicle.bodies)


def axle_on_tire(axle: int, vehicle: Vehicle, load_case: LoadCase) -> AxleOnTire:
    """The axle as a quarter car: tributary mass from the scales, unsprung mass with its share of a common beam."""
    record = vehicle.axles[axle]
    return AxleOnTire(
        axle=axle,
        load_case=load_case.name,
        mass=float(static_equilibrium(vehicle, load_case).tributary_mass_kg[axle]),
        unsprung_mass=vehicle.unsprung_mass_kg[axle],
        tire_stiffness=record.tire_stiffness_N_per_m,
        tire_damping=record.tire_damping_N_s_per_m,
    )


def _deflection(drop: PlankDrop, vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Times and deflection (clipped readings as missing), left and right averaged, and remarks about them."""
    channels = [
        channel
        for channel in drop.log.channels
        if channel.sensor.kind == "suspension_deflection" and channel.sensor.axle in (None, drop.axle)
    ]
    if not channels:
        columns = ", ".join(channel.sensor.column for channel in drop.log.channels) or "no channel"
        raise DataRejectedError(
            f"{drop.log.file}: no suspension deflection of axle '{vehicle.axles[drop.axle].name}' among {columns}; "
            'declare one with kind = "suspension_deflection" in [sensors.plank_drop].'
        )
    time = channels[0].time_s
    values = [_measured(channel, time) for channel in channels]
    remarks = []
    clipped = int(sum(np.count_nonzero(channel.censored) for channel in channels))
    if clipped:
        remarks.append(f"{clipped} clipped readings left out")
    if len(values) == 1:
        return time, values[0], remarks
    spans = [float(np.nanmax(v) - np.nanmin(v)) if np.isfinite(v).any() else 0.0 for v in values]
    if max(spans) - min(spans) > _SIDE_DISAGREEMENT * max(spans):
        names = " and ".join(channel.sensor.column for channel in channels)
        remarks.append(f"{names} move by {' and '.join(f'{1e3 * s:.0f}' for s in spans)} mm, their mean is used")
    # If one side is missing, the other replaces it, at the same level.
    stack = np.stack(values)
    both = np.all(np.isfinite(stack), axis=0)
    if not both.any():
        return time, values[int(np.argmax([np.isfinite(v).sum() for v in values]))], remarks
    level = stack[:, both].mean(axis=1, keepdims=True)
    centred = stack - level
    count = np.isfinite(centred).sum(axis=0)
    total = np.where(np.isfinite(centred), centred, 0.0).sum(axis=0)
    mean = np.where(count > 0, total / np.maximum(count, 1) + level.mean(), np.nan)
    return time, mean, remarks


def _measured(channel: Channel, time: np.ndarray) -> np.ndarray:
    if channel.time_s.shape == time.shape and np.array_equal(channel.time_s, time):
        return np.where(channel.censored == 0, channel.value, np.nan)
    return readings_at(channel, time, clipped=False)


def _read(
    drop: PlankDrop, vehicle: Vehicle, time: np.ndarray, deflection: np.ndarray, settings: DropSettings
) -> tuple[PreparedRecord, FreeDecayFit]:
    """Prepared record and free-decay fit, the peaks sought only where the motion is free.

    That is after the first turn (the axle is falling until then), after the tire has left the plank's edge if the speed
    is declared, and from where the free-decay model fits, if it does. A lifted body is free immediately after its
    release.
    """
    search, falling = settings.frequency_range_hz, drop.release == "plank"
    record = prepare_record(time, deflection, frequency_range_hz=search, skip_first_turn=falling)
    if record.release is None or record.extrema is None:
        return record, fit_free_decay(record)
    earliest = -np.inf
    if drop.nominal_speed_m_s and drop.plank_height_m is not None:
        radius, height = vehicle.axles[drop.axle].tire_radius_m, drop.plank_height_m
        way = np.sqrt(max(2.0 * radius * height - height**2, 0.0)) + _CONTACT_LENGTH_RADII * radius
        earliest = record.release.time_s + way / drop.nominal_speed_m_s
    fit = fit_free_decay(record, earliest_s=earliest)
    if not falling:
        return record, fit  # a fitted hop would take a part of the friction along, and nothing shakes the wheels here
    if fit.usable and not fit.poor:
        record = prepare_record(
            time,
            deflection,
            frequency_range_hz=search,
            earliest_s=max(earliest, fit.window_s[0]),
            period_s=fit.damped_period,
            skip_first_turn=True,
            ripple=(fit.time_s, fit.hop_model) if fit.hop is not None else None,
        )
    elif np.isfinite(earliest):
        record = prepare_record(time, deflection, frequency_range_hz=search, earliest_s=earliest, skip_first_turn=True)
    return record, fit


def _with_period(
    record: PreparedRecord,
    time: np.ndarray,
    deflection: np.ndarray,
    drop: PlankDrop,
    settings: DropSettings,
    law: DampingLaw,
) -> PreparedRecord:
    """The record with extrema sought at the law's period, where the one of a viscous mode has missed them."""
    if record.extrema is not None and record.extrema.used.sum() >= 5:
        return record
    return prepare_record(
        time,
        deflection,
        frequency_range_hz=settings.frequency_range_hz,
        period_s=law.damped_period,
        skip_first_turn=drop.release == "plank",
    )


def _estimates(
    axle: AxleOnTire,
    settings: DropSettings,
    file: str,
    reading: DecayReading,
    fit: FreeDecayFit,
    remarks: list[str],
) -> tuple[DropEstimate, ...]:
    note = "; ".join([reading.note, *remarks] if reading.note else remarks)
    estimates = []
    if reading.usable and reading.log_decrement > 0.0:
        covariance = np.diag([reading.damped_period_se**2, reading.log_decrement_se**2])
        for method in ("paper", "corrected"):
            estimates.append(
                estimate(method, axle, settings, file, reading.damped_period, reading.log_decrement, covariance, note)
            )
    else:
        why = note if not reading.usable else "the swings do not decay"
        estimates += [unusable("paper", axle, file, why), unusable("corrected", axle, file, why)]
    note = "; ".join([fit.note, *remarks] if fit.note else remarks)
    if not fit.usable:
        return (*estimates, unusable("free_decay", axle, file, note))
    sigma, omega = fit.decay_rate, fit.angular_frequency
    to_reading = np.array([[0.0, -2.0 * np.pi / omega**2], [2.0 * np.pi / omega, -2.0 * np.pi * sigma / omega**2]])
    covariance = to_reading @ fit.covariance @ to_reading.T
    note = "; ".join(part for part in (note, _disagreement(reading, fit, float(covariance[1, 1]))) if part)
    return (
        *estimates,
        estimate("free_decay", axle, settings, file, fit.damped_period, fit.log_decrement, covariance, note),
    )


def _estimates_by_law(
    axle: AxleOnTire, settings: DropSettings, file: str, law: DampingLaw, remarks: list[str]
) -> tuple[DropEstimate, ...]:
    """All three methods on the viscous part of a mixture of damping."""
    shares = " + ".join(
        f"{100.0 * share:.0f} % {name}"
        for name, share in zip(("viscous", "dry friction", "quadratic"), law.shares, strict=True)
        if share > 0.0
    )
    notes = [f"damping of the swings: {shares}"]
    if np.isfinite(law.stick_time_s):
        notes.append(f"sticks {1e3 * abs(float(law.model[-1]) - law.level):.1f} mm beside the level")
    note = "; ".join([*notes, *([law.note] if law.note else []), *remarks])
    methods: tuple[DropMethod, ...] = ("paper", "corrected", "free_decay")
    return tuple(estimate_by_law(method, axle, settings, file, law, note) for method in methods)


def _disagreement(reading: DecayReading, fit: FreeDecayFit, fit_variance: float) -> str:
    """A remark where the fitted decrement and the one of the peaks differ by more than errors and scatter explain."""
    if not reading.usable:
        return ""
    difference = abs(fit.log_decrement - reading.log_decrement)
    error = np.sqrt(fit_variance + reading.log_decrement_se**2)
    if difference <= max(_DECREMENT_DISAGREEMENT * reading.log_decrement, 4.0 * error):
        return ""
    return (
        f"its decrement {fit.log_decrement:.2f} and that of the peaks {reading.log_decrement:.2f} disagree, "
        "so the motion is not one viscously damped mode"
    )
