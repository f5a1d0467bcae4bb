"""Analysis of one plank drop: from the log to stiffness and damping by three methods."""

from __future__ import annotations

import numpy as np

from sysid.campaign.gaps import readings_at
from sysid.campaign.records import Channel, PlankDrop
from sysid.campaign.statics import static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import DataRejectedError
from sysid.sdof.decay import PreparedRecord, prepare_record, reading_of, smooth_record
from sysid.sdof.decay_fit import fit_decay
from sysid.sdof.drop_results import DecayFit, DecayReading, DropAnalysis, DropEstimate, DropMethod
from sysid.sdof.equations import directive_damping
from sysid.sdof.estimates import AxleOnTire, estimate, of_fit, unusable, with_bias
from sysid.sdof.second_drop import second_drop
from sysid.sdof.settings import DropSettings

_PEAKS: tuple[DropMethod, ...] = ("paper", "corrected")
_SIDE_DISAGREEMENT = 0.2  # relative difference of left and right that is worth a remark
_BEFORE_TURN = 0.1  # of a period before the turning point where the fit begins
_BLOCK_PERIODS = 0.6  # of the slowest body mode: holds a whole swing and little of the next
_CONTACT_LENGTH_RADII = 0.25  # half the footprint of a truck tire in tire radii, roughly


def analyse_drop(
    drop: PlankDrop, vehicle: Vehicle, load_case: LoadCase, settings: DropSettings | None = None
) -> DropAnalysis:
    """Estimate stiffness and damping of the axle under test from one plank drop.

    Methods ``paper`` (equations (1)-(3) on the picked peaks), ``corrected`` (the same reading, tire in series, tire
    damping and unsprung mass taken out exactly, see `invert_quarter_car`) and ``free_decay`` (the quarter car fitted to
    the readings, averaged over its models, see `fit_decay`).  All three take the axle for the only one under its body.
    The standard deviations of the first two hold their difference from the third, which is their bias: what the peaks
    of a record with a tire, friction or a curved spring show is not k and c.  A record that holds a second drop is read
    up to there.

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
    axle = axle_on_tire(drop.axle, vehicle, load_case)
    record = _prepare(drop, time, whole, settings)
    again = second_drop(time, whole, _BLOCK_PERIODS / settings.frequency_range_hz[0])
    deflection = np.where(time <= again, whole, np.nan)
    if np.isfinite(again):
        remarks.append(f"a second drop begins at {again:.2f} s, the record is read up to there")
        record = _prepare(drop, time, deflection, settings)
    fit = fit_decay(
        record,
        axle,
        settings,
        from_release=drop.release == "body",
        neighbours=has_neighbours(vehicle),
        earliest_s=_off_the_plank(drop, vehicle, record),
    )
    free_decay = np.full(time.size, np.nan)
    note = "; ".join(remarks)
    fitted = (
        of_fit(fit, axle, drop.log.file, note)
        if isinstance(fit, DecayFit)
        else unusable("free_decay", axle, drop.log.file, "; ".join([fit, *remarks]))
    )
    if isinstance(fit, DecayFit):
        inside = (time >= fit.window_s[0]) & (time <= fit.window_s[1])
        free_decay[inside] = np.interp(time[inside], fit.time_s, fit.model)
        if drop.release == "plank" and fitted.usable:
            # The peaks are sought where the fitted motion is free, at its period.
            begin = fit.window_s[0] - _BEFORE_TURN * fit.damped_period
            record = _prepare(drop, time, deflection, settings, earliest_s=begin, period_s=fit.damped_period)
    reading = reading_of(record)
    rows = (*_of_peaks(axle, settings, drop.log.file, reading, fit, fitted, remarks), fitted)
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
        free_decay_note=rows[-1].note,
        estimates=rows,
        frequency_hz=1.0 / reading.damped_period,
        damping_ratio_directive=float(directive_damping(reading.log_decrement)),
        damping_kind=rows[-1].damping_kind,
        fit=fit if isinstance(fit, DecayFit) else None,
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
        leaf=record.suspension == "leaf",
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
    # If one side is missing, the other replaces it, at the same level and in proportion to its own motion.
    stack = np.stack(values)
    both = np.all(np.isfinite(stack), axis=0)
    if not both.any():
        return time, values[int(np.argmax([np.isfinite(v).sum() for v in values]))], remarks
    level = stack[:, both].mean(axis=1, keepdims=True)
    centred = stack - level
    moves = centred[:, both]
    power = np.sum(moves**2, axis=1)
    scale = np.where(power > 0.0, moves @ moves.mean(axis=0) / np.where(power > 0.0, power, 1.0), 1.0)
    centred *= np.where(both, 1.0, scale[:, None])
    count = np.isfinite(centred).sum(axis=0)
    total = np.where(np.isfinite(centred), centred, 0.0).sum(axis=0)
    mean = np.where(count > 0, total / np.maximum(count, 1) + level.mean(), np.nan)
    return time, mean, remarks


def _measured(channel: Channel, time: np.ndarray) -> np.ndarray:
    if channel.time_s.shape == time.shape and np.array_equal(channel.time_s, time):
        return np.where(channel.censored == 0, channel.value, np.nan)
    return readings_at(channel, time, clipped=False)


def _prepare(
    drop: PlankDrop,
    time: np.ndarray,
    deflection: np.ndarray,
    settings: DropSettings,
    earliest_s: float | None = None,
    period_s: float | None = None,
) -> PreparedRecord:
    """The record with its peaks sought after the first turn of a falling axle; a lifted body is free at once."""
    return prepare_record(
        time,
        deflection,
        frequency_range_hz=settings.frequency_range_hz,
        earliest_s=earliest_s,
        period_s=period_s,
        skip_first_turn=drop.release == "plank",
    )


def _off_the_plank(drop: PlankDrop, vehicle: Vehicle, record: PreparedRecord) -> float:
    """When the tire has left the edge of the plank [s], by the declared speed; minus infinity without one."""
    if record.release is None or not drop.nominal_speed_m_s or drop.plank_height_m is None:
        return float("-inf")
    radius, height = vehicle.axles[drop.axle].tire_radius_m, drop.plank_height_m
    way = np.sqrt(max(2.0 * radius * height - height**2, 0.0)) + _CONTACT_LENGTH_RADII * radius
    return float(record.release.time_s + way / drop.nominal_speed_m_s)


def _of_peaks(
    axle: AxleOnTire,
    settings: DropSettings,
    file: str,
    reading: DecayReading,
    fit: DecayFit | str,
    fitted: DropEstimate,
    remarks: list[str],
) -> tuple[DropEstimate, ...]:
    """Rows of the methods on the peaks; where no quarter car explains the record, its peaks tell nothing of one."""
    read = "; ".join([reading.note, *remarks] if reading.note else remarks)
    why = read if not reading.usable else "the swings do not decay" if reading.log_decrement <= 0.0 else ""
    if why or isinstance(fit, str):
        return tuple(unusable(method, axle, file, why or fitted.note) for method in _PEAKS)
    covariance = np.diag([reading.damped_period_se**2, reading.log_decrement_se**2])
    rows = (
        estimate(method, axle, settings, file, reading.damped_period, reading.log_decrement, covariance, read)
        for method in _PEAKS
    )
    return tuple(with_bias(row, fit) if row.usable else row for row in rows)
