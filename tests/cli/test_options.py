"""Help, README and hints name the options that there are, and the command that was typed."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import get_args

import click
import pytest
from click.testing import CliRunner

from sysid.cli.later import LaterGroup
from sysid.cli.main import cli
from sysid.cli.stages import INTERRUPTED
from sysid.planning.ranking import CANDIDATE_KM_H
from sysid.posterior.options import SamplingOptions
from sysid.road.contact_laws import CONTACT_LAWS, ContactLaw
from sysid.workflow import Calibration, make_settings
from sysid.workflow.stages import RECORDS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
STAGES = set(cli.commands)


def options(stage: str) -> set[str]:
    """Options of a stage as they are typed, those of the commands below it among them."""
    command = cli.commands[stage]
    below = [*command.whole().commands.values()] if isinstance(command, LaterGroup) else []
    return {p.opts[0] for c in (command, *below) for p in c.params if isinstance(p, click.Option)}


def table() -> dict[str, set[str]]:
    """Options that README's table names, by the stage they belong to; those of all stages under "run"."""
    rows = README.split("| option | |\n|---|---|\n")[1].split("\n\n")[0].splitlines()
    found: dict[str, set[str]] = {"run": set()}
    for first in (row.split(" | ")[0] for row in rows):
        stage = re.match(r"\| `(\w+)`: ", first)
        found.setdefault(stage[1] if stage else "run", set()).update(re.findall(r"`(--[\w-]+)", first))
    return found


def test_the_readme_names_every_option_of_every_stage_and_no_other() -> None:
    documented = table()
    assert documented["run"] == options("run")
    for stage in STAGES - {"run", "selftest"}:
        assert documented.get(stage, set()) == options(stage) - options("run"), stage
    assert documented["selftest"] | {"--seed"} == options("selftest")


def test_the_readme_and_the_help_name_every_stage() -> None:
    text = CliRunner().invoke(cli, ["--help"]).output
    for stage in STAGES:
        assert re.search(rf"^ +{stage} ", text, re.MULTILINE), stage
        assert re.search(rf"^python calibrate.py {stage} ", README, re.MULTILINE), stage


@pytest.mark.parametrize("words", [["--help"], ["fleet", "--help"]], ids=lambda w: w[0])
def test_the_list_of_commands_cuts_no_sentence_at_80_columns(words: list[str]) -> None:
    listed = CliRunner().invoke(cli, words, terminal_width=80).output.split("Commands:")[1].splitlines()[1:]
    assert len(listed) >= 8
    assert [line for line in listed if not line.endswith(".") or line.endswith("...") or len(line) > 80] == []


@pytest.mark.parametrize("text", [README, CliRunner().invoke(cli, ["--help"]).output], ids=["README", "help"])
def test_every_exit_code_is_named(text: str) -> None:
    (codes,) = re.findall(r"Exit codes: (.*?)\.\s", text, re.DOTALL)
    assert [int(code) for code in re.findall(r"\b\d+\b", codes)] == [0, 1, 2, 3, 4, 130]


@pytest.mark.parametrize(
    ("stage", "option", "default"),
    [
        ("run", "--max-steps", str(SamplingOptions().max_steps)),
        ("run", "--seed", str(make_settings().seed)),
        ("run", "--laws", make_settings().fit.laws),
        ("run", "--contact", make_settings().fit.contact),
        ("advise", "--candidate-speed", ", ".join(f"{v:g}" for v in CANDIDATE_KM_H)),
    ],
)
def test_defaults_in_the_help_are_those_of_the_settings(stage: str, option: str, default: str) -> None:
    (found,) = [p for p in cli.commands[stage].params if option in p.opts]
    assert isinstance(found, click.Option)
    assert f"(default: {default})" in str(found.help)


def test_numbers_arrive_in_the_kind_that_the_record_says() -> None:
    """A count stays a whole number, at both ends of its limits too, and 2.5 of them are refused."""
    counts = 0
    for stage in RECORDS:
        for option in stage.command.options if stage.command else ():
            if option.limits is None:
                continue
            (typed,) = (p for p in cli.commands[stage.name].params if p.name == option.name)
            for number in map(option.kind, option.limits):
                if not (option.above and number == option.limits[0]):
                    assert type(typed.type.convert(str(number), typed, None)) is option.kind, option.flag
            if option.kind is int:
                counts += 1
                with pytest.raises(click.BadParameter):
                    typed.type.convert("2.5", typed, None)
    assert counts >= 2


def test_the_choices_of_contact_laws_are_the_laws_that_there_are() -> None:
    (found,) = [p for p in cli.commands["run"].params if "--contact" in p.opts]
    assert isinstance(found.type, click.Choice)
    assert tuple(found.type.choices) == get_args(ContactLaw) == tuple(CONTACT_LAWS)
    (row,) = [line for line in README.splitlines() if line.startswith("| `--contact LAW`")]
    assert set(re.findall(r"`(\w+)`", row)) == set(CONTACT_LAWS)


def stopped(monkeypatch: pytest.MonkeyPatch, arguments: list[str], program: str = "calibrate.py") -> list[str]:
    """Words of the command that is offered after Ctrl-C while the campaign is read."""

    def interrupt(*given: object, **more: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Calibration, "__init__", interrupt)
    result = CliRunner().invoke(cli, arguments, prog_name=program)
    assert result.exit_code == INTERRUPTED
    return shlex.split(result.stderr.split("go on with: ")[1])


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "data", "--output", "my output", "--seed", "0", "--contact", "cams", "--max-steps", "9"],
        ["fit", "--quick", "--contact-spread"],
        ["profile", "data", "--parameter", "k_3", "--parameter", "c_6"],
        ["predict", "--speed", "40.0", "--speed", "48.5", "--load-case", "unloaded"],
        ["validate", "--leave-out", "case1_unloaded_16kmh_run1"],
        ["sample", "--resume"],
    ],
    ids=lambda a: a[0],
)
def test_the_hint_after_ctrl_c_is_the_command_typed_and_resume(monkeypatch, arguments: list[str]) -> None:
    offered = stopped(monkeypatch, arguments)
    assert offered[1:3] == ["calibrate.py", arguments[0]]
    # The interpreter that runs, under a name by which this shell finds it.
    found = Path(shutil.which(offered[0]) or offered[0]).absolute()
    assert (found.parent, found.stem[:6]) == (Path(sys.executable).absolute().parent, "python")
    # Typed again, the hint means the same.
    parsed = [
        cli.commands[arguments[0]].make_context(arguments[0], list(words)).params
        for words in ([*arguments[1:], "--resume"], offered[3:])
    ]
    assert parsed[0] == parsed[1]
    assert offered.count("--resume") == 1


def test_messages_carry_the_name_of_the_installed_command(monkeypatch, tmp_path: Path) -> None:
    assert stopped(monkeypatch, ["check"], program="sysid") == ["sysid", "check", "--resume"]
    monkeypatch.undo()
    missing = CliRunner().invoke(cli, ["check", str(tmp_path / "no"), "--output", str(tmp_path)], prog_name="sysid")
    assert missing.stderr.startswith("sysid check: ")


def test_a_seed_of_zero_is_a_choice(monkeypatch, tmp_path: Path) -> None:
    seen = []

    def keep(self: Calibration, campaign: Path, output: Path, settings, *given: object, **more: object) -> None:
        seen.append(settings)
        raise KeyboardInterrupt

    (tmp_path / "stages").mkdir()
    kept = '{"quick": true, "seed": 5, "laws": "declared", "contact": "cams", "contact_spread": false}'
    (tmp_path / "stages" / "settings.json").write_text(kept)
    monkeypatch.setattr(Calibration, "__init__", keep)
    for more in ([], ["--seed", "0"], ["--seed", "2"]):
        CliRunner().invoke(cli, ["report", "data", "--output", str(tmp_path), *more])
    assert [(s.quick, s.seed) for s in seen] == [(True, 5), (False, 0), (False, 2)]
