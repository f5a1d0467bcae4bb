"""How a run moves along the road: speed and start at its first axle, and a constant acceleration."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.vehicle_model.device_arrays import HostOrDevice, RunsBySets


class MotionChange(NamedTuple):
    """Small departures (R, S) from a motion, linear in their effect: for derivatives with respect to it.

    `speed` [m/s], `start_s` [s], `acceleration` [m/s2].
    """

    speed: HostOrDevice
    start_s: HostOrDevice
    acceleration: HostOrDevice


class Motion(NamedTuple):
    """How each run moves along the road with each parameter set, (R, S).

    With v the `speed` [m/s] at which axle 1 passes the start of the bump at t_0 = `start_s` [s], and a the constant
    `acceleration` [m/s2], axle 1 has come

        s = v tau + a tau^2 / 2,    tau = t - t_0,

    and the forward speed is v + a tau.  A run that brakes to a stand stays there: before or after, tau is that of the
    stand.  `change` is a small departure for which the road is not looked up again, None without one.
    """

    speed: HostOrDevice
    start_s: HostOrDevice
    acceleration: HostOrDevice | float = 0.0
    change: MotionChange | None = None

    def since_start(self, time_s: HostOrDevice) -> jax.Array:
        """tau [s], at most (in size) where the run stands."""
        tau = time_s - self.start_s
        standing = self.speed + self.acceleration * tau < 0.0
        return jnp.where(standing, -self.speed / jnp.where(standing, self.acceleration, 1.0), tau)

    def travelled(self, time_s: HostOrDevice) -> jax.Array:
        """How far axle 1 is past the start of the bump [m]."""
        tau = self.since_start(time_s)
        return jnp.asarray(tau * (self.speed + 0.5 * self.acceleration * tau))

    def speed_at(self, time_s: HostOrDevice) -> jax.Array:
        """Forward speed [m/s]."""
        return jnp.asarray(self.speed + self.acceleration * self.since_start(time_s))

    def ahead(self, change: MotionChange, time_s: HostOrDevice) -> RunsBySets:
        """How far the run is ahead [m] after a small change, to first order."""
        tau = self.since_start(time_s)
        moved = tau * (change.speed + 0.5 * change.acceleration * tau)
        return jnp.asarray(moved - self.speed_at(time_s) * change.start_s)

    def faster(self, change: MotionChange, time_s: HostOrDevice) -> RunsBySets:
        """By how much the run is faster [m/s] after a small change, to first order."""
        tau = self.since_start(time_s)
        gained = change.speed + tau * change.acceleration - self.acceleration * change.start_s
        return jnp.where(self.speed_at(time_s) > 0.0, gained, 0.0)


def acceleration_of(change: HostOrDevice, speed: HostOrDevice, length_m: float) -> np.ndarray:
    """Constant acceleration [m/s2] by which a speed changes by the share `change` over a length.

        a = ((1 + change)^2 - 1) v^2 / (2 L)

    Parameters
    ----------
    change : relative change of the speed, -1 to come to a stand.
    speed : v [m/s] before it.
    length_m : L [m]; over no length nothing changes.
    """
    if length_m <= 0.0:
        return np.zeros(np.shape(speed))
    return np.asarray(change * (1.0 + 0.5 * change) * speed**2 / length_m)
