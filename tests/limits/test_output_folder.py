"""Names that no output folder can have: one sentence and exit code 2, nothing written."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from sysid.cli.output_option import folder
from sysid.errors import CampaignError
from sysid.output_folder import output_folder

BAD = {
    "empty": ("", "is empty"),
    "blank": ("  ", "is empty"),
    "minus": ("-", "is '-'"),
    "long": ("a" * 300, "300 characters"),
    "long part": ("results/" + "b" * 256 + "/run", "256 characters"),
    "long path": ("/".join(["abcdefg"] * 600), "shorter"),
    "bell": ("out\x07", "control characters"),
    "line end": ("out\nput", "control characters"),
    "zero byte": ("out\0put", "control characters"),
    "escape": ("\x1b[31mout", "control characters"),
}


@pytest.mark.parametrize(("name", "said"), BAD.values(), ids=BAD)
def test_a_name_that_no_folder_can_have_is_one_sentence(name: str, said: str) -> None:
    with pytest.raises(CampaignError) as error:
        output_folder(name)
    text = str(error.value)
    assert text.startswith("--output")
    assert said in text
    assert text.isprintable()
    assert error.value.exit_code == 2


@pytest.mark.parametrize("name", ["out", "a/b/c", ".", "Ergebnis Mai", "\U0001f69a", "b" * 255])
def test_usual_names_are_taken_as_they_are(name: str) -> None:
    assert output_folder(name) == Path(name)


def test_a_file_on_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("")
    for path in (tmp_path / "results", tmp_path / "results" / "run" / "1"):
        with pytest.raises(CampaignError, match="names a file, results"):
            output_folder(path)


@pytest.mark.parametrize("name", ["", "-", "a" * 300, "out\x07"])
def test_the_option_exits_with_2_before_anything_runs(name: str) -> None:
    ran = []

    @click.command()
    @click.option("--output", default="output", type=folder)
    def command(output: Path) -> None:
        ran.append(output)

    result = CliRunner().invoke(command, ["--output", name])
    assert (result.exit_code, ran) == (2, [])
    assert "--output" in result.output
    assert "Traceback" not in result.output
    assert CliRunner().invoke(command, []).exit_code == 0
    assert ran == [Path("output")]
