"""Numbers behind the interactive figures: every channel of every run, every axle of every predicted pass.

The page draws them itself; without a script it falls back on its static figures.  Samples are stored as 16-bit
integers in base64, 1/32000 of the largest value of a channel apart, which no screen can tell from the original.  The
ends of a posterior band lie close to the simulated curve: what they are off it is stored in 8 bits.
"""

from __future__ import annotations

import base64
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from sysid.display import Z90
from sysid.numbers import speed
from sysid.plot import axle_color, channel_title
from sysid.plot.style import INK, display
from sysid.results import Results
from sysid.results.pass_limits import pass_name
from sysid.wording import plain_text

if TYPE_CHECKING:
    from sysid.estimation.residuals.run_history import RunHistory
    from sysid.prediction.predicted_passes import PassPrediction

#: Code of a missing sample.
MISSING_CODE = -32768
_FULL_SCALE = 32000
_BAND_SCALE = 127
#: Most samples of all curves together, 2.7 bytes each; longer campaigns are thinned evenly.
MOST_SAMPLES = 800_000


def runs_data(results: Results) -> Markup | None:
    """All channels of all fitted runs as JSON for a data block of the page; None without a fit."""
    if results.fit is None or not results.fit.histories:
        return None
    histories = results.fit.histories
    # Measured and simulated, and two ends of the band at half the size.
    stride = _stride(sum((2 if h.band is None else 3) * h.measured.size for h in histories))
    return _json([_run(history, stride) for history in histories])


def passes_data(results: Results) -> Markup | None:
    """Load ratio of all axles of all predicted passes as JSON for a data block of the page; None without any."""
    if results.predictions is None or not results.predictions.passes:
        return None
    passes = results.predictions.passes
    stride = _stride(sum(3 * p.tire_force_q50_N.size for p in passes))
    return _json([_pass(p, stride) for p in passes])


def _stride(samples: int) -> int:
    """How many samples stand for one in the page."""
    return max(1, math.ceil(samples / MOST_SAMPLES))


def _run(history: RunHistory, stride: int) -> dict[str, Any]:
    words = f"{history.case}, driven at {speed(history.speed_m_s)} km/h ({history.file})"
    channels = []
    for row in range(len(history.columns)):
        measured, unit = display(history.measured[row, ::stride], history.si_units[row])
        simulated, _ = display(history.simulated[row, ::stride], history.si_units[row])
        scatter, _ = display(np.asarray(history.noise_sd[row]), history.si_units[row])
        if not np.isfinite(measured).any():
            continue
        scale = _scale(measured, simulated)
        axle = history.axles[row]
        channels.append(
            {
                "name": plain_text(channel_title(history, row)),
                "unit": unit,
                "color": INK if axle is None else axle_color(axle),
                "scale": scale,
                "measured": _packed(measured, scale),
                "middle": _packed(simulated, scale),
                "scatter": Z90 * float(scatter) if math.isfinite(float(scatter)) else 0.0,
                "clipped": np.flatnonzero(history.censored[row, ::stride]).tolist(),
            }
            | _posterior_band(history, row, stride)
        )
    return {"name": plain_text(words), **_time(history.time_s, stride), "channels": channels}


def _posterior_band(history: RunHistory, row: int, stride: int) -> dict[str, Any]:
    """Ends of the posterior's band of a channel less the simulated curve; nothing before sampling."""
    if history.band is None:
        return {}
    ends = np.array([history.band.low[row, ::stride], history.band.high[row, ::stride]])
    offset, _ = display(ends - history.simulated[row, ::stride], history.si_units[row])
    if not np.isfinite(offset).all():
        return {}
    step = float(np.max(np.abs(offset))) / _BAND_SCALE or 1.0
    low, high = (_text(np.round(end / step).astype(np.int8)) for end in offset)
    return {"band_step": step, "band_low": low, "band_high": high}


def _pass(p: PassPrediction, stride: int) -> dict[str, Any]:
    channels = []
    for axle, static in enumerate(p.static_load_N):
        curves = {"middle": p.tire_force_q50_N[axle, ::stride] / static}
        if p.tire_force_q05_N is not None and p.tire_force_q95_N is not None:
            curves |= {"low": p.tire_force_q05_N[axle, ::stride] / static}
            curves |= {"high": p.tire_force_q95_N[axle, ::stride] / static}
        scale = _scale(*curves.values())
        channels.append(
            {"name": f"axle {axle + 1}", "unit": "-", "color": axle_color(axle), "scale": scale}
            | {name: _packed(values, scale) for name, values in curves.items()}
        )
    name = plain_text(pass_name(p))
    return {"name": name, **_time(p.time_s, stride), "channels": channels}


def _time(time_s: np.ndarray, stride: int) -> dict[str, float]:
    step = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0
    return {"start": float(time_s[0]) if len(time_s) else 0.0, "step": stride * step, "every": stride}


def _scale(*curves: np.ndarray) -> float:
    largest = max((float(np.nanmax(np.abs(c))) for c in curves if np.isfinite(c).any()), default=1.0)
    return largest / _FULL_SCALE or 1.0


def _packed(values: np.ndarray, scale: float) -> str:
    codes = np.where(np.isfinite(values), np.round(np.nan_to_num(values) / scale), MISSING_CODE).astype("<i2")
    return _text(codes)


def _text(codes: np.ndarray) -> str:
    return base64.b64encode(codes.tobytes()).decode("ascii")


def _json(content: list[dict[str, Any]]) -> Markup:
    # Inside a script element only "<" could end it early; ASCII output leaves no other special character.
    text = json.dumps(content, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))
