"""How the program was called: its name for messages, and the same command again."""

from __future__ import annotations

import logging
import os
import shlex
import subprocess
import warnings
from collections.abc import Callable

import click
from click.core import ParameterSource
from rich.console import Console


def program() -> str:
    """What a user types before the name of a stage: ``python calibrate.py``, or the installed command."""
    name = name_of_program()
    return f"python {name}" if name.endswith(".py") else name


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
    words = program().split()
    if context is not None and context.parent is not None:
        words += [str(context.info_name), *_typed_words(context)]
    words += [option for option in more if option not in words]
    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


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


def _typed_words(context: click.Context) -> list[str]:
    words: list[str] = []
    for parameter in context.command.params:
        name = str(parameter.name)
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
