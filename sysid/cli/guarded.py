"""Commands that work without an output folder of a campaign: their errors are one sentence each, and an exit code."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console

from sysid.cli.invocation import tell
from sysid.cli.stages import INTERRUPTED, console, termination_as_interrupt
from sysid.errors import SysidError


def guarded(name: str, stopped: str, do: Callable[[Console, Console], int]) -> int:
    """Exit code of the command `name`, which `do` runs with the terminal for results and that for errors.

    `stopped` is what the user is told after Ctrl-C.
    """
    screen, errors = console(False), console(True)
    with termination_as_interrupt():
        try:
            return do(screen, errors)
        except SysidError as error:
            tell(errors, name, str(error))
            return error.exit_code
        except KeyboardInterrupt:
            errors.print(stopped, markup=False)
            return INTERRUPTED
        except Exception as error:
            tell(errors, name, f"an unexpected error stopped it ({type(error).__name__}: {error}); please report it.")
            return SysidError.exit_code
