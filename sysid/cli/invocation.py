"""How the program was called: its name for messages, and the same command again."""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from rich.console import Console

#: Name of the program when it runs as a module.
MODULE = "python -m sysid"


def program() -> str:
    """What a user types before the name of a stage, as a shell takes it: ``python calibrate.py``, or ``sysid``."""
    return quoted(_program_words())


def quoted(words: Sequence[str]) -> str:
    """Words as a command that a shell takes apart again into the same words."""
    if os.name == "nt":
        import subprocess

        return subprocess.list2cmdline(words)
    return shlex.join(words)


def command_line(*words: object) -> str:
    """A command of this program that can be pasted: `words` follow the program as it was called."""
    return quoted([*_program_words(), *map(str, words)])


def next_command(*words: str) -> str:
    """A further command on the campaign and the output folder of the running one, with the options that it keeps.

    The campaign, the folder and the options of the calibration stand as they were typed, `--quick` is left out.
    """
    context = click.get_current_context(silent=True)
    typed = [] if context is None or context.parent is None else _typed_words(context, _CARRIED)
    return command_line(words[0], *typed, *words[1:])


#: Parameters of a command that the next one on the same campaign needs again.
_CARRIED = ("campaign", "output", "seed", "max_steps", "laws", "contact", "contact_spread")


def _program_words() -> list[str]:
    name = name_of_program()
    if name == MODULE:
        return [_interpreter(), "-m", "sysid"]
    if not name.endswith(".py"):
        return [name]
    typed = sys.argv[0] if Path(sys.argv[0]).name == name else name
    return [_interpreter(), typed]


def _interpreter() -> str:
    """``python`` where that is the interpreter that runs, else its path, from here if it lies below."""
    found = shutil.which("python")
    if found is None or os.path.dirname(os.path.abspath(found)) != os.path.dirname(os.path.abspath(sys.executable)):
        near = os.path.relpath(sys.executable) if Path(sys.executable).is_relative_to(Path.cwd()) else sys.executable
        return near or "python"
    return "python"


def name_of_program() -> str:
    """The name with which messages begin."""
    context = click.get_current_context(silent=True)
    return (context and context.find_root().info_name) or "calibrate.py"


def tell(errors: Console, name: str, text: str) -> None:
    """A sentence of the command `name`, with the name of the program before it."""
    errors.print(f"{name_of_program()} {name}: {text}", markup=False)


def same_command(*more: str) -> str:
    """The running command as it was typed, with further options; only the program outside a command."""
    context = click.get_current_context(silent=True)
    words = _program_words()
    if context is not None and context.parent is not None:
        words += [str(context.info_name), *_typed_words(context)]
    words += [option for option in more if option not in words]
    return quoted(words)


class _Sentences(logging.Handler):
    """Hands what the package logs to the terminal, in the words of the command."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())


def configured(say: Callable[[str], None]) -> None:
    """Settings of the process as :func:`sysid.runtime.configure` makes them; its warnings go to `say`, one each."""
    from sysid.runtime import configure

    logger = logging.getLogger("sysid")
    logger.handlers = [*(h for h in logger.handlers if not isinstance(h, _Sentences)), _Sentences(say)]

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        configure()
    for warning in caught:
        say(str(warning.message))


def _typed_words(context: click.Context, names: Sequence[str] | None = None) -> list[str]:
    """Arguments and options as they were typed, only those of `names` if these are given."""
    words: list[str] = []
    for parameter in context.command.params:
        name = str(parameter.name)
        if names is not None and name not in names:
            continue
        if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            continue
        value = context.params[name]
        if isinstance(parameter, click.Option) and parameter.is_flag:
            words.append(parameter.opts[0])
        elif isinstance(parameter, click.Option):
            for each in value if parameter.multiple else (value,):
                words += [parameter.opts[0], str(each)]
        else:
            words.append(str(value))
    return words
