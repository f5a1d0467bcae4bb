"""Draws docs/images/truck.svg: truck, sensors, axes and signs.

python docs/make_truck_drawing.py
"""

from __future__ import annotations

from pathlib import Path

TARGET = Path(__file__).resolve().parent / "images" / "truck.svg"
#: Pixels per metre, x of axle 1, level of the road, wheel radius and height of the frame [pixels].
SCALE, X0, ROAD, RADIUS, FRAME = 84.0, 250.0, 400.0, 44.0, 268.0
AXLES_M = (0.0, 4.2, 5.55)
INK, STEEL, SENSOR, RULE = "#222", "#8a94a3", "#b3261e", "#1f5fa8"


def text(x: float, y: float, words: str, *, size: int = 15, colour: str = INK, anchor: str = "start") -> str:
    """A line of words."""
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


def line(x1: float, y1: float, x2: float, y2: float, colour: str = INK, width: float = 2.0, more: str = "") -> str:
    """A straight line."""
    return f'<path d="M{x1:g} {y1:g}L{x2:g} {y2:g}" stroke="{colour}" stroke-width="{width:g}" fill="none" {more}/>'


def arrow(x1: float, y1: float, x2: float, y2: float, colour: str) -> str:
    """A line with a head at its end."""
    return line(x1, y1, x2, y2, colour, 2.5, f'marker-end="url(#{colour.strip("#")})"')


def head(colour: str) -> str:
    """The head of the arrows of a colour."""
    return (
        f'<marker id="{colour.strip("#")}" markerWidth="9" markerHeight="9" refX="7" refY="4" orient="auto">'
        f'<path d="M0 0L8 4L0 8Z" fill="{colour}"/></marker>'
    )


def spring(x: float, top: float, bottom: float) -> str:
    """A zigzag between frame and axle."""
    steps = [(x + (9 if i % 2 else -9), top + (bottom - top) * (i + 0.5) / 7) for i in range(7)]
    points = " ".join(f"{px:.1f},{py:.1f}" for px, py in [(x, top), *steps, (x, bottom)])
    return f'<polyline points="{points}" fill="none" stroke="{STEEL}" stroke-width="3"/>'


def axle(number: int, x: float) -> list[str]:
    """Wheel, spring and the three sensors of one axle."""
    centre = ROAD - RADIUS
    parts = [
        f'<circle cx="{x:g}" cy="{centre:g}" r="{RADIUS:g}" fill="#f4f4f4" stroke="{INK}" stroke-width="3"/>',
        f'<circle cx="{x:g}" cy="{centre:g}" r="7" fill="{INK}"/>',
        spring(x - 16, FRAME + 12, centre - 8),
        line(x - 16, centre - 8, x + 18, centre - 8, INK, 4),
        text(x, ROAD + 62, f"axle {number}", anchor="middle"),
        # Deflection: a rod between frame and axle, with heads at both ends.
        line(x + 14, FRAME + 12, x + 14, centre - 8, SENSOR, 2.5),
        f'<rect x="{x + 8:g}" y="{FRAME + 22:g}" width="12" height="26" fill="{SENSOR}"/>',
        f'<rect x="{x - 33:g}" y="{centre - 16:g}" width="16" height="16" fill="{RULE}"/>',
        f'<rect x="{x - 8:g}" y="{FRAME - 18:g}" width="16" height="16" fill="{RULE}"/>',
    ]
    return parts


def drawing() -> str:
    """The whole picture."""
    xs = [X0 + SCALE * a for a in AXLES_M]
    centre = ROAD - RADIUS
    bump = X0 - 150
    body = [
        f'<rect x="{X0 - 60:g}" y="{FRAME:g}" width="{SCALE * 6.6 + 60:g}" height="12" fill="{STEEL}"/>',
        f'<path d="M{X0 - 62:g} {FRAME:g}V150q0 -28 28 -28H{X0 + 112:g}V{FRAME:g}Z" fill="#e8eef7" stroke="{INK}"/>',
        f'<path d="M{X0 - 48:g} 200V150q0 -14 14 -14H{X0 + 30:g}V200Z" fill="#fff" stroke="{STEEL}"/>',
        f'<rect x="{X0 + 128:g}" y="96" width="{SCALE * 6.6 - 128:g}" height="172" fill="#eef2ea" stroke="{INK}"/>',
        line(20, ROAD, 880, ROAD, INK, 2),
        f'<path d="M{bump - 46:g} {ROAD:g}q46 -34 92 0Z" fill="#d9c9a3" stroke="{INK}"/>',
        text(bump, ROAD + 24, "bump, from the scan", anchor="middle"),
    ]
    signs = [
        text(X0 + 54, FRAME + 36, "frame-axle distance,", colour=SENSOR),
        text(X0 + 54, FRAME + 54, "+ when they move apart", colour=SENSOR),
        arrow(X0, FRAME - 22, X0, FRAME - 64, RULE),
        text(X0 + 14, FRAME - 42, "frame", colour=RULE),
        text(X0 + 14, FRAME - 24, "acceleration, + up", colour=RULE, size=12),
        arrow(X0 - 25, centre - 18, X0 - 25, centre - 54, RULE),
        text(X0 - 40, centre - 50, "axle acceleration, + up", colour=RULE, anchor="end"),
        arrow(X0 - 80, 60, X0 - 165, 60, INK),
        text(X0 - 70, 65, "direction of travel"),
        arrow(xs[0], ROAD + 84, xs[2] + 60, ROAD + 84, INK),
        line(xs[0], ROAD + 74, xs[0], ROAD + 94),
        text(xs[2] + 66, ROAD + 89, "x_m, rearward"),
        *(line(x, ROAD + 78, x, ROAD + 90) for x in xs[1:]),
        text(xs[0] - 8, ROAD + 106, "x_m = 0", anchor="middle", size=13),
        *(text(x, ROAD + 106, f"{a:g}", anchor="middle", size=13) for x, a in zip(xs[1:], AXLES_M[1:], strict=True)),
        arrow(840, ROAD - 8, 840, ROAD - 70, INK),
        text(850, ROAD - 56, "z"),
    ]
    axles = [part for i, x in enumerate(xs) for part in axle(i + 1, x)]
    label = "Side view of a truck with its sensors, axes and signs"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 900 520" font-family="sans-serif" role="img" '
            f'aria-label="{label}">',
            '<rect width="900" height="520" fill="#fff"/>',
            "<defs>" + "".join(head(c) for c in (INK, RULE, SENSOR)) + "</defs>",
            *body,
            *axles,
            *signs,
            "</svg>\n",
        ]
    )


if __name__ == "__main__":
    TARGET.write_text(drawing(), encoding="utf-8")
