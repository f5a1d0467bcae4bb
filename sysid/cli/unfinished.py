"""The command `check` on a campaign file that is not finished: what is left to fill in, and the check of its logs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from sysid.campaign.inputs.paths import campaign_file
from sysid.campaign.toml.todo import Doubt, Todo, find_doubts, find_todos
from sysid.cli.guarded import guarded
from sysid.cli.invocation import next_command, tell
from sysid.cli.stages import console, run_stage
from sysid.errors import CampaignError, SysidError


def run_check(campaign: Path, output: Path, **choices: Any) -> int:
    """Check a campaign and return the exit code: 2 where values are still to be filled in, and nothing is written."""
    try:
        todos, doubts = _todos_and_doubts(campaign)
    except SysidError:
        # The stage says the same with all else that it says of such a file.
        todos, doubts = (), ()
    if not todos:
        code = run_stage("check", campaign, output, **choices)
        if doubts and code != CampaignError.exit_code:
            from sysid.cli.tables import render

            render(console(False), _doubts(doubts))
        return code
    return guarded("check", "Stopped; nothing was written.", partial(_check_logs, campaign, todos, doubts))


def _todos_and_doubts(campaign: Path) -> tuple[tuple[Todo, ...], tuple[Doubt, ...]]:
    from sysid.campaign.toml.reading import parse_toml

    content = campaign_file(campaign)
    tables = parse_toml(content.data, content.name)
    return find_todos(tables), find_doubts(content.data.decode("utf-8", errors="replace"))


def _check_logs(
    campaign: Path, todos: tuple[Todo, ...], doubts: tuple[Doubt, ...], screen: Console, errors: Console
) -> int:
    from sysid.campaign.quality.check import check_quality
    from sysid.campaign.read import read_campaign
    from sysid.cli.progress import StageProgress
    from sysid.cli.tables import render, show_command
    from sysid.workflow.stages.data import quality_blocks

    say = partial(tell, errors, "check")
    code = CampaignError.exit_code
    try:
        with StageProgress(errors) as progress:
            progress.stage("reading campaign and logs")
            report = check_quality(read_campaign(campaign, unfinished=True))[1]
        render(screen, quality_blocks(report))
    except SysidError as error:
        say(f"the rest cannot be checked yet: {error}")
    render(screen, ["To fill in:", *(f"  {todo.where}: {todo.what}" for todo in todos), *_doubts(doubts)])
    values = "1 value" if len(todos) == 1 else f"{len(todos)} values"
    told = f"{values} to fill in; the logs were checked with what is there, and nothing was written. Fill them in, then"
    show_command(screen, told, next_command("check"))
    return code


def _doubts(doubts: tuple[Doubt, ...]) -> list[str]:
    if not doubts:
        return []
    head = "To confirm (then remove 'TODO confirm' from the line):"
    return [head, *(f"  line {doubt.line}, {doubt.entry}: {doubt.what}" for doubt in doubts)]
