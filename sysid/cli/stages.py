"""What each command does: run a stage with a progress bar, print its result, turn errors into one sentence."""

from __future__ import annotations

import errno
import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from sysid.cli import tables
from sysid.cli.invocation import configured, name_of_program, same_command
from sysid.cli.passes import OPTIONS, requested_passes
from sysid.cli.progress import StageProgress
from sysid.errors import DataRejectedError, NotConvergedError, OutputError, SysidError
from sysid.folder_lock import cannot_write

INTERRUPTED = 130
#: Errors of the system that say no more than that nothing can be written here.
_NO_WRITING = (errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT)


def run_stage(name: str, campaign: Path, output: Path, *, resume: bool, **choices: Any) -> int:
    """Run one command and return its exit code; `choices` are those of :func:`sysid.workflow.make_settings`."""
    screen, errors = console(False), console(True)
    with termination_as_interrupt():
        try:
            return _run(name, campaign, output, screen, errors, resume, choices)
        except SysidError as error:
            errors.print(f"{name_of_program()} {name}: {error}", markup=False)
            return error.exit_code
        except KeyboardInterrupt:
            errors.print(
                f"Stopped. What is done is kept in {output}; go on with: {same_command('--resume')}", markup=False
            )
            return INTERRUPTED
        except OSError as error:
            if error.errno not in _NO_WRITING:
                return _unexpected(name, output, error, errors)
            errors.print(f"{name_of_program()} {name}: {cannot_write(output, error)}", markup=False)
            return OutputError.exit_code
        except Exception as error:
            return _unexpected(name, output, error, errors)


def _unexpected(name: str, output: Path, error: Exception, errors: Console) -> int:
    kept = _keep_traceback(output)
    errors.print(
        f"{name_of_program()} {name}: an unexpected error stopped the run ({type(error).__name__}: {error}). What is "
        f"done is kept in {output}; please report it{kept}.",
        markup=False,
    )
    return SysidError.exit_code


def _keep_traceback(output: Path) -> str:
    """Write the traceback of the running exception into the output folder; where it went, in words."""
    try:
        path = output / "error.log"
        path.write_text(traceback.format_exc(), encoding="utf-8")
    except OSError:
        return ""
    return f" with the file {path}"


def _run(name, campaign, output, screen, errors, resume, choices) -> int:
    from sysid.workflow import KEPT_CHOICES, Calibration, make_settings, recall

    configured(lambda text: errors.print(f"{name_of_program()} {name}: {text}", markup=False))
    asked = {option: choices.pop(option, None) for option in OPTIONS}
    speeds, profiled = choices.pop("candidate_speeds", ()), choices.pop("profiled", ())
    left_out, all_out = choices.pop("left_out", ()), choices.pop("leave_one_out", False)
    passes_only = any(value not in (None, ()) for value in asked.values())
    # A seed of 0 is a choice as well, and equal to False.
    chosen = any(choices.get(option) is not None and choices[option] is not False for option in KEPT_CHOICES)
    if (name in ("report", "export", "advise", "profile", "validate", "crosscheck") or passes_only) and not chosen:
        # These show what is there: without options they take those of the run that filled the folder.
        choices |= recall(output)
    settings = make_settings(**choices)
    result: Any
    written: tuple[Path, ...] = ()
    with StageProgress(errors) as progress:

        def notice(text: str) -> None:
            errors.print(f"{name_of_program()} {name}: {text}", markup=False)

        calibration = Calibration(campaign, output, settings, progress.update, resume=resume, notice=notice)
        if passes_only:
            from sysid.export.tables import write_passes

            requests = requested_passes(calibration.campaign, asked)
            progress.stage(name)
            result = calibration.predict_passes(requests)
            written = write_passes(result, output)
        elif name == "advise":
            calibration.redo(name)
            progress.stage(name)
            result = calibration.advise(*([speeds] if speeds else []))
            calibration.export()
        elif name == "crosscheck":
            calibration.redo(name)
            progress.stage(name)
            result = calibration.crosscheck()
            calibration.export()
        elif name == "profile":
            progress.stage(name)
            result = calibration.profile(profiled)
            calibration.export()
        elif name == "validate":
            progress.stage(name)
            result = (
                calibration.leave_out(() if all_out else left_out) if left_out or all_out else calibration.validate()
            )
            calibration.export()
        elif name in ("check", "drops", "fit", "sample", "predict"):
            if not resume:
                calibration.redo(name)
            progress.stage(name)
            result = getattr(calibration, name)()
            calibration.export()
        elif name == "report":
            progress.stage(name)
            result = calibration.report()
            calibration.export()
        elif name == "export":
            result = calibration.export()
        else:
            progress.stage("calibration")
            result = calibration.run()
    show = getattr(tables, f"show_{name}")
    show(screen, calibration, result)
    for path in written:
        screen.print(str(path), markup=False)
    return _exit_code(name, calibration)


def _exit_code(name: str, calibration) -> int:
    """0; 3 where the check rejects a channel; 4 where what was asked for has not converged; a preview is 0."""
    if name == "check" and any(f.verdict == "rejected" for f in calibration.check().channels):
        return DataRejectedError.exit_code
    if calibration.settings.quick:
        return 0
    if name == "fit" and not calibration.fit().converged:
        return NotConvergedError.exit_code
    if name == "sample" and not calibration.sample().converged:
        return NotConvergedError.exit_code
    if name == "crosscheck" and not calibration.crosscheck().agrees:
        return NotConvergedError.exit_code
    if name == "run" and calibration.results().status != "converged":
        return NotConvergedError.exit_code
    return 0


def console(stderr: bool) -> Console:
    """A console that does not squeeze tables into 80 columns when its output goes to a file."""
    console = Console(stderr=stderr, highlight=False)
    return console if console.is_terminal else Console(stderr=stderr, highlight=False, width=200, soft_wrap=True)


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """A polite kill is treated like Ctrl-C: what is done is kept and the way to go on is said."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not in the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
