"""Type of the option --output: a folder that can be made, else one sentence and exit code 2."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.errors import CampaignError
from sysid.output_folder import output_folder


def folder(text: str | Path) -> Path:
    """Name of the output folder as a path; the text is checked before it becomes one.

    Raises
    ------
    click.UsageError
        If no folder can have this name; click prints it and exits with 2.
    """
    try:
        return output_folder(text)
    except CampaignError as error:
        raise click.UsageError(str(error)) from None
