"""Options of a calibration, the same for the stages of one campaign and for a fleet.

The names of laws stand here as well as in the settings because the help is shown without loading NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def decorated(command: Callable[..., Any], *decorators: Decorator) -> Callable[..., Any]:
    """The command with arguments and options, shown in this order."""
    for decorate in reversed(decorators):
        command = decorate(command)
    return command


def calibration_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options that decide how a campaign is calibrated."""
    return decorated(
        command,
        click.option("--quick", is_flag=True, help="Preview: few iterations, a short chain; results are marked so."),
        click.option("--seed", default=None, help="Seed of everything random (default: 0).", type=click.IntRange(0)),
        click.option("--max-steps", default=None, help="Limit of sampling steps per ensemble (default: 1500).",
                     type=click.IntRange(1)),
        click.option("--laws", default=None, type=click.Choice(["auto", "compare", "declared"]),
                     help="Suspension laws of axles without a declared one: richer ones where linear ones "
                          "leave residuals that they may explain (auto), compared in any case, or as declared "
                          "(default: auto)."),
        click.option("--contact", default=None, type=click.Choice(["footprint", "cams", "point"]),
                     help="Contact law of the tires: radial springs over the footprint, tandem elliptical cams, or a "
                          "point follower (default: footprint)."),
        click.option("--contact-spread", is_flag=True,
                     help="Repeat the fit with the other contact laws and show how much the results change."),
    )  # fmt: skip
