"""Mode shapes drawn on a side view of the vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from sysid.plot.style import FAINT, INK, MUTED, axes_grid, axes_or_new, axle_color, label, styled

if TYPE_CHECKING:
    from sysid.vehicle_model.vibration_modes import NaturalModes

#: Largest displacement in a figure as a share of the length shown, how far a body reaches beyond its outermost
#: supports [m], how far bodies are drawn above the wheel centres [m], and the room before and behind the vehicle [m].
_SWING = 0.05
_OVERHANG_M = 0.6
_FRAME_ABOVE_WHEEL_M = 0.75
_ROOM_M = 1.4


@styled
def mode_shape(modes: NaturalModes, mode: int, ax: Axes | None = None) -> Axes:
    """One mode (index) on a side view: the vehicle at rest in grey, displaced in colour, travelling to the left.

    Bodies are bars through their supports, beams of axle groups thinner ones, wheels circles in the colour of their
    axle.  The largest displacement in the figure has a fixed size; fore-aft motion is not drawn.
    """
    ax = axes_or_new(ax, 6.4, 2.0)
    x, radius = (np.array([getattr(a, k) for a in modes.vehicle.axles]) for k in ("x_m", "tire_radius_m"))
    lines = _lines(modes, mode)
    # Where a body ends it may move more than any coordinate.
    moved = [np.abs(rise).max() for _, _, rise, _ in lines] + [np.abs(modes.wheel_rise[:, mode]).max()]
    (left, right), (bottom, top), swing = _window(modes)
    scale = swing / max(moved)
    for place, height, rise, style in lines:
        ax.plot(place, height, color=FAINT, **style)
        ax.plot(place, height + scale * rise, color=INK, **style)
    for i in range(x.size):
        rise = scale * modes.wheel_rise[i, mode]
        ax.add_patch(Circle((x[i], radius[i]), radius[i], fc="none", ec=FAINT, lw=1.0))
        ax.add_patch(Circle((x[i], radius[i] + rise), radius[i], fc="none", ec=axle_color(i), lw=1.5))
    ax.axhline(0.0, color=MUTED, lw=0.7)
    ax.set_title(
        f"mode {mode + 1}: {modes.frequency_hz[mode]:.3g} Hz, ζ {modes.damping_ratio[mode]:.2g}, "
        f"{label(modes.dominant[mode], 20)}"
    )
    ax.set_aspect("equal")
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    ax.set_xlabel("x behind axle 1 [m]")
    ax.set_yticks([])
    ax.grid(False)
    ax.spines["left"].set_visible(False)
    return ax


@styled
def mode_shapes(modes: NaturalModes, columns: int = 2) -> np.ndarray:
    """All modes on side views, in the order of their frequency; returns the axes, (rows, columns)."""
    count = modes.frequency_hz.size
    rows = -(-count // columns)
    (left, right), (bottom, top), _ = _window(modes)
    width = 3.4
    height = width * (top - bottom) / (right - left)
    grid = axes_grid(rows, columns, (width, height), (0.2, 0.2, 0.45, 0.3, 0.2, 0.3))
    for k, ax in enumerate(grid.flat):
        if k >= count:
            ax.set_axis_off()
            continue
        mode_shape(modes, k, ax)
        if k + columns < count:
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
    return grid


def _window(modes: NaturalModes) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Limits along and above the road [m], and the largest displacement drawn [m]."""
    x = [a.x_m for a in modes.vehicle.axles]
    left, right = min(x) - _ROOM_M, max(x) + _ROOM_M
    swing = _SWING * (right - left)
    highest = float(np.mean([a.tire_radius_m for a in modes.vehicle.axles])) + _FRAME_ABOVE_WHEEL_M
    return (left, right), (-swing - 0.1, highest + swing + 0.25), swing


def _lines(modes: NaturalModes, mode: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]]:
    """Bodies and beams as (x, height at rest, rise, line style), suspensions as dotted lines between them."""
    vehicle = modes.vehicle
    x, radius = (np.array([getattr(a, k) for a in vehicle.axles]) for k in ("x_m", "tire_radius_m"))
    frame = float(radius.mean()) + _FRAME_ABOVE_WHEEL_M
    solid: dict[str, Any] = {"lw": 3.0, "solid_capstyle": "round"}
    lines = []

    def rise_of(body: int, place: np.ndarray) -> np.ndarray:
        _, heave, pitch = modes.body_motion[body, :, mode]
        bent = np.interp(place, modes.frame_x_m[body], modes.frame_rise[body, :, mode])
        return np.asarray(heave - pitch * (place - modes.cg_x_m[body]) + bent)

    for b, body in enumerate(vehicle.bodies):
        supports = [a.x_m for a in vehicle.axles if a.body == b]
        joints = [other.hitch_x_m for other in (body, *vehicle.bodies[b + 1 : b + 2]) if other.hitch_x_m is not None]
        front, rear = min(supports + joints), max(supports + joints)
        # Ends at a hinge meet the other body there; free ends reach a little further.
        front -= 0.0 if front in joints else _OVERHANG_M
        rear += 0.0 if rear in joints else _OVERHANG_M
        place = np.array([front, rear]) if body.bending is None else np.linspace(front, rear, 25)
        lines.append((place, np.full(place.size, frame), rise_of(b, place), solid))
    owner, support = np.array(vehicle.suspension_axle), np.array(vehicle.suspension_x_m)
    for i in sorted(set(owner)):
        on = np.flatnonzero(owner == i)
        wheels = modes.wheel_rise[on, mode]
        if on.size > 1:
            lines.append((x[on], radius[on], wheels, {**solid, "lw": 1.8}))
        below = float(np.polyval(np.polyfit(x[on] - support[i], wheels, min(1, on.size - 1)), 0.0))
        place = np.full(2, support[i])
        ends = np.array([float(rise_of(vehicle.axles[i].body, place[:1])[0]), below])
        lines.append((place, np.array([frame, float(radius[on].mean())]), ends, {"lw": 1.0, "ls": ":"}))
    return lines
