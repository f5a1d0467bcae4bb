"""The planar vehicle as a right-hand side y' = f(t, y) in numba, written from docs/model.md for general solvers.

y holds body coordinates, axle rises, and the rates of both.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SOFT_DAMPING = 0.1


@njit(error_model="numpy")
def _road(c, i, s, advance, row, slope):
    """Rows of the map of axle i and their slopes, `advance` beyond s by Taylor's theorem; False where it is flat."""
    count = c.table.shape[2]
    scaled = (s - c.first_station) / c.step
    if scaled <= 2.0 or scaled >= count - 4.0:
        return False
    cell = int(scaled)
    t = scaled - cell
    basis = np.zeros((4, 6))
    for k in range(6):
        # Horner's scheme for the polynomial and its first three derivatives over their factorials.
        for power in range(5, -1, -1):
            for order in range(3, 0, -1):
                basis[order, k] = basis[order, k] * t + basis[order - 1, k]
            basis[0, k] = basis[0, k] * t + c.polynomial[power, k]
    a = advance / c.step
    for r in range(8):
        d0, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0
        for k in range(6):
            coefficient = c.table[r, i, cell - 2 + k]
            d0 += basis[0, k] * coefficient
            d1 += basis[1, k] * coefficient
            d2 += basis[2, k] * coefficient
            d3 += basis[3, k] * coefficient
        if r > 0:
            d3 = 0.0
        row[r] = d0 + a * (d1 + a * (d2 + a * d3))
        slope[r] = (d1 + a * (2.0 * d2 + 3.0 * a * d3)) / c.step
    return True


@njit(error_model="numpy")
def _tire(c, i, flat, row, slope, speed, rise, rise_rate):
    """Vertical and forward force of tire i."""
    rest = c.rest[i]
    if flat:
        deflection, rate, drag = rest - rise, -rise_rate, 0.0
    else:
        below = row[0] - rise
        below_rate = slope[0] * speed - rise_rate
        lowest = row[4] - rest
        w, w_rate = below, below_rate
        if below <= lowest:
            w, w_rate = lowest, speed * slope[4]
        deflection = rest + below + w * (row[1] + w * (row[2] + w * row[3]))
        rate = below_rate + w_rate * (row[1] + w * (2.0 * row[2] + 3.0 * w * row[3]))
        rate += speed * w * (slope[1] + w * (slope[2] + w * slope[3]))
        drag = row[5] + w * (row[6] + w * row[7])
    relative = deflection / c.reference[i]
    if relative <= 0.0:
        size = -relative
        elastic = -c.reference_load[i] * size ** c.exponent[i]
        rate = -abs(rate)
    else:
        size = relative
        elastic = c.reference_load[i] * size ** c.exponent[i]
    length = size * math.sqrt((1.0 + SOFT_DAMPING) / (size + SOFT_DAMPING))
    vertical = max(0.0, elastic + c.tire_damping[i] * rate * length)
    return vertical, vertical * drag


@njit(error_model="numpy")
def rates(t, y, out, c, extension):
    """f(t, y) into `out`, and the suspension extensions into `extension`."""
    nb, na = c.position.shape[1], c.rest.size
    half = nb + na
    row, slope = np.empty(8), np.empty(8)
    for j in range(half):
        out[j] = y[half + j]
    for j in range(nb):
        total = 0.0
        for k in range(nb):
            total += c.position[2 * na + j, k] * y[k] + c.rate[2 * na + j, k] * y[half + k]
        out[half + j] = total
    for i in range(na):
        above, above_rate, advance, speed = -y[nb + i], -y[half + nb + i], 0.0, c.speed
        for k in range(nb):
            above += c.position[i, k] * y[k]
            above_rate += c.rate[i, k] * y[half + k]
            advance += c.position[na + i, k] * y[k]
            speed += c.rate[na + i, k] * y[half + k]
        s = c.speed * (t - c.start) - c.axle_x[i]
        flat = not _road(c, i, s, advance, row, slope)
        vertical, forward = _tire(c, i, flat, row, slope, speed, y[nb + i], y[half + nb + i])
        pull = c.stiffness[i] * above + c.damping[i] * above_rate
        extension[i] = above
        out[half + nb + i] = c.inverse_unsprung[i] * (vertical - c.static_load[i] + pull)
        for j in range(nb):
            out[half + j] += c.acceleration[j, i] * pull + c.acceleration[j, na + i] * forward


@njit(error_model="numpy")
def signals(times, states, deflection_axles, acceleration_axles, c):
    """Unfiltered signals (T, C) of states (T, 2 (nb + na)): deflections, axle and body accelerations."""
    nb, na = c.position.shape[1], c.rest.size
    first, second, third = deflection_axles.size, acceleration_axles.size, c.body_rows.shape[0]
    found = np.zeros((times.size, first + second + third))
    out, extension = np.empty(2 * (nb + na)), np.empty(na)
    for n in range(times.size):
        rates(times[n], states[n], out, c, extension)
        for k in range(first):
            found[n, k] = extension[deflection_axles[k]]
        for k in range(second):
            found[n, first + k] = out[nb + na + nb + acceleration_axles[k]]
        for k in range(third):
            for j in range(nb):
                found[n, first + second + k] += c.body_rows[k, j] * out[nb + na + j]
    return found
