"""Where the wheels of simulated passes are: from coordinates of the bodies and deflections of the suspensions."""

from __future__ import annotations

import numpy as np

from sysid.road.wheel_paths import WheelPaths
from sysid.vehicle_model.stacked_matrices import StackedMatrices
from sysid.vehicle_model.suspension import SuspensionLaw


def wheel_paths(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    body: np.ndarray,
    extension_m: np.ndarray,
    place_m: np.ndarray,
) -> WheelPaths:
    """Paths of the wheels' centres in t passes.

    Parameters
    ----------
    matrices, suspension : of the passes.
    body : (T, nb, t) coordinates of the bodies.
    extension_m : (T, na, t) deflections of the suspensions, positive in extension [m].
    place_m : (T, na, t) where the axles are at the speed that is held [m].
    """
    axles = place_m.shape[1]
    position = matrices.position if matrices.beams is None else _turned(matrices.position, matrices.beams.wheel)
    above, ahead = (
        np.einsum("taj,sjt->sat", position[:, part], body) for part in (slice(0, axles), slice(axles, 2 * axles))
    )
    if suspension.trailing is not None:
        # Links lead a wheel aft as it rises, forward as the suspension extends.
        ahead = ahead + suspension.trailing[:, :, 0].T * extension_m
    return WheelPaths(place_m + ahead, above - extension_m)


def _turned(position: np.ndarray, wheel: np.ndarray) -> np.ndarray:
    """Rows of the bodies above the wheels in place of those above the coordinates of common beams."""
    axles = wheel.shape[1]
    return np.concatenate([wheel @ position[:, :axles], position[:, axles:]], axis=1)
