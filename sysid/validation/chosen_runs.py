"""Runs that somebody names to leave them out."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.errors import CampaignError


def chosen_runs(files: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Those of the bump runs `files` that are named, all of them for none.

    A name is the file, or its last part with or without extension.

    Raises
    ------
    CampaignError
        If a name fits no run or several, or the campaign has one run only.
    """
    if len(files) < 2:
        raise CampaignError(
            "A run can be left out only where another one is left to fit; the campaign has fewer than two."
        )
    chosen = []
    for name in names:
        fitting = [f for f in files if name == f or name in (f.rsplit("/")[-1], f.rsplit("/")[-1].rsplit(".", 1)[0])]
        if len(fitting) != 1:
            several = "fits several runs" if fitting else "is none of the runs that can be used"
            raise CampaignError(f"--leave-out {name} {several}; give one of {', '.join(files)}.")
        chosen += fitting
    return tuple(dict.fromkeys(chosen or files))
