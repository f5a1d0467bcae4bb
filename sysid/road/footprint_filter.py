"""The road as a tire feels it where it is gentle: the radial springs' response to small unevenness is a moving average.

A flat road compresses the spoke at the angle phi by delta = R - (R - u) / cos(phi).  A small height z of the road under
it, at x = (R - u) tan(phi), changes its force in proportion to p delta^(p - 1) z.  At constant load the wheel centre
therefore rises by the mean of z over the contact with these weights, which are largest at its ends, and the forward
force is that of the inclined spokes:

    W(s) = int w(phi) z(s + x) dphi,    G / F = -(k / F) int w(phi) tan(phi) (z(s + x) - W(s)) dphi,

with w ~ delta^(p - 1), of mean 1, and the tangent stiffness k at the load F.  It is the limit of
:mod:`sysid.road.enveloping` for small heights, and takes no table of the road.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid.arrays import Stations

#: Points of the integral over half a contact.
_POINTS = 400


class FootprintFilter(NamedTuple):
    """Weights (2 m + 1,) on stations `step_m` apart, m before to m behind the wheel centre, of the rise and of G / F.

    `rise` has the sum 1, `drag` [1/m] the sum 0.
    """

    step_m: float
    rise: np.ndarray
    drag: np.ndarray

    def applied(self, height_m: Stations) -> tuple[Stations, Stations]:
        """Rise [m] and G / F [-] of a wheel over heights (n,) on stations `step_m` apart; level beyond both ends."""
        reach = self.rise.size // 2
        padded = np.pad(height_m, reach, mode="edge")
        # np.convolve turns the second argument around.
        rise, drag = (np.convolve(padded, weights[::-1], mode="valid") for weights in (self.rise, self.drag))
        return rise, drag


def footprint_filter(
    radius_m: float, deflection_m: float, load_N: float, stiffness_N_per_m: float, exponent: float, step_m: float
) -> FootprintFilter:
    """Weights of a tire that rests on flat road.

    Parameters
    ----------
    radius_m, deflection_m : radius R and static deflection u [m] of the spokes.
    load_N, stiffness_N_per_m : load F [N] and tangent stiffness k [N/m] there.
    exponent : p of a spoke.
    step_m : distance of the stations [m].
    """
    edge = np.arccos(1.0 - deflection_m / radius_m)
    # phi = edge sin(t): the weight's singular end becomes a smooth one.
    t = (np.arange(-_POINTS, _POINTS) + 0.5) * (0.5 * np.pi / _POINTS)
    phi = edge * np.sin(t)
    shorter = np.maximum(radius_m - (radius_m - deflection_m) / np.cos(phi), 1e-300)
    weight = shorter ** (exponent - 1.0) * np.cos(t)
    weight /= weight.sum()
    place = (radius_m - deflection_m) * np.tan(phi) / step_m
    reach = int(np.ceil(np.abs(place).max())) + 1
    cell = np.floor(place).astype(int)
    share = place - cell

    def on_stations(values: np.ndarray) -> np.ndarray:
        # The road is straight between its stations.
        return np.bincount(cell + reach, values * (1.0 - share), 2 * reach + 1) + np.bincount(
            cell + reach + 1, values * share, 2 * reach + 1
        )

    drag = -stiffness_N_per_m / load_N * on_stations(weight * np.tan(phi))
    return FootprintFilter(step_m, on_stations(weight), drag)
