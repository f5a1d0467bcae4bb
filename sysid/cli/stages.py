"""What each command does: run a stage with a progress bar, print its result, turn errors into one sentence."""

from __future__ import annotations

import errno
import signal
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from sysid.cli.invocation import command_line, configured, same_command, tell
from sysid.display import CommandHint
from sysid.errors import CampaignError, NotConvergedError, OutputError, StoredResultsError, SysidError
from sysid.files import write_text
from sysid.folder_lock import cannot_write
from sysid.wording import plain_text, shorten
from sysid.workflow.stage import Blocks, Command, Ending, Stage, Whole
from sysid.workflow.stages import EXPORT, RECORDS, SUMMARY

if TYPE_CHECKING:
    from sysid.campaign.declared import Declared
    from sysid.cli.progress import StageProgress
    from sysid.results.contents import Results
    from sysid.workflow import Calibration

#: Exit code after Ctrl-C, as shells give it: 128 and the number of the signal.
INTERRUPTED = 130
#: Signals that ask a process to end; Windows has the first alone.
_POLITE = ("SIGTERM", "SIGHUP")
#: Name of the report in the output folder.
REPORT_FILE = "report.html"
#: Files written aside that are listed by name.
_LISTED = 12
#: Errors of the system that say no more than that nothing can be written here.
_NO_WRITING = (errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT)


def run_stage(name: str, campaign: Path, output: Path, *, resume: bool, **choices: Any) -> int:
    """Run one command and return its exit code; `choices` are those of :func:`sysid.workflow.make_settings`."""
    screen, errors = console(False), console(True)
    with termination_as_interrupt():
        try:
            return _run(name, campaign, output, screen, errors, resume, choices)
        except SysidError as error:
            tell(errors, name, str(error))
            return error.exit_code
        except KeyboardInterrupt:
            errors.print(
                f"Stopped. What is done is kept in {output}; go on with: {same_command('--resume')}", markup=False
            )
            return INTERRUPTED
        except OSError as error:
            if error.errno not in _NO_WRITING:
                return _unexpected(name, output, error, errors)
            tell(errors, name, str(cannot_write(output, error)))
            return OutputError.exit_code
        except Exception as error:
            return _unexpected(name, output, error, errors)


def _unexpected(name: str, output: Path, error: Exception, errors: Console) -> int:
    kept = _keep_traceback(output)
    what = f"{type(error).__name__}: {error}"
    tell(
        errors,
        name,
        f"an unexpected error stopped the run ({what}). What is done is kept in {output}; please report it{kept}.",
    )
    return SysidError.exit_code


@contextmanager
def _stored_results_doubted(calibration: Calibration, output: Path) -> Iterator[None]:
    """Doubt results that were read back when something breaks that rests on them.

    A stage file is checked along the types of its result.  That its arrays fit each other and the campaign is not:
    the program writes no others, but somebody who sends a folder can.

    Raises
    ------
    StoredResultsError
        For any unexpected error after a result was read back.
    """
    try:
        yield
    except (SysidError, OSError):
        raise
    except Exception as error:
        if not calibration.read_back:
            raise
        kept = _keep_traceback(output)
        raise StoredResultsError(
            f"The stored results in {output.name}/ ({', '.join(sorted(calibration.read_back))}) do not fit each other "
            f"or the campaign ({type(error).__name__}: {shorten(error, 100)}): they were changed, or the program is at "
            f"fault; run all stages again without --resume, and if that does not help report it{kept}."
        ) from error


def _keep_traceback(output: Path) -> str:
    """Write the traceback of the running exception into the output folder; where it went, in words."""
    try:
        path = output / "error.log"
        write_text(path, traceback.format_exc())
    except OSError:
        return ""
    return f" with the file {path}"


def _run(
    name: str, campaign: Path, output: Path, screen: Console, errors: Console, resume: bool, choices: dict[str, Any]
) -> int:
    as_json, opens = choices.pop("as_json", False), choices.pop("opens", False)
    declared = check_campaign(campaign)
    if (record := _record(name)) is not None:
        _command(record).refuse(declared, choices)
    # Bars and tables take longer to load than the answer to a slip in the campaign file.
    from sysid.cli.progress import StageProgress
    from sysid.cli.tables import render

    with StageProgress(errors) as progress:
        progress.stage("reading campaign and logs")
        calibration, outcome = _compute(name, campaign, output, errors, progress, resume, choices)
        with _stored_results_doubted(calibration, output):
            results = calibration.results()
            shown = () if as_json else tuple(_blocks(name, outcome, results, output))
    if as_json:
        from sysid.export.result_json import result_text

        # Not by the console, which would fold long lines.
        click.echo(result_text(results), nl=False)
    render(screen, shown)
    for line in () if as_json else _listed(outcome.written):
        screen.print(line, markup=False, soft_wrap=True)
    if opens:
        import webbrowser

        webbrowser.open((outcome.written or (output / REPORT_FILE,))[0].resolve().as_uri())
    return _exit_code(outcome, calibration.settings.quick)


def _listed(written: Sequence[Path]) -> list[str]:
    """Paths of files; of many, how many each folder holds."""
    if len(written) <= _LISTED:
        return [str(path) for path in written]
    count = Counter(path.parent for path in written)
    return [f"{number} files in {folder}" for folder, number in count.items()]


def _blocks(name: str, outcome: _Outcome, results: Results, output: Path) -> Blocks:
    """What a command shows, and the command that comes next."""
    record = _record(name)
    if record is None:
        from sysid.cli.answer import show_run

        yield from show_run(results, output / REPORT_FILE)
        return
    command = _command(record)
    yield from command.show(outcome.result, results)
    if command.next:
        yield CommandHint("Next", command.next)


def _record(name: str) -> Stage[Any] | Ending | None:
    """The record of a command; None for the whole run."""
    return next((r for r in RECORDS if r.name == name), None)


def check_campaign(campaign: Path) -> Declared:
    """What a campaign file declares, checked before anything heavy is loaded; `init` is offered where there is none.

    Raises
    ------
    CampaignError
        If it is missing or wrong.
    """
    from sysid.campaign.declared import check_declared

    if campaign.is_dir() and not any(p.suffix == ".toml" for p in campaign.iterdir()):
        raise CampaignError(
            f"{shorten(campaign, 100)} holds no campaign.toml; write one from the logs in it: "
            f"{command_line('init', campaign)}"
        )
    return check_declared(campaign)


def _compute(
    name: str,
    campaign: Path,
    output: Path,
    errors: Console,
    progress: StageProgress,
    resume: bool,
    choices: dict[str, Any],
) -> tuple[Calibration, _Outcome]:
    from sysid.workflow import KEPT_CHOICES, Calibration, make_settings, recall

    notice = partial(tell, errors, name)
    configured(notice)
    record = _record(name)
    options = () if record is None or record.command is None else record.command.options
    typed = {option.name: choices.pop(option.name, None) for option in options}
    typed = {option.name: typed[option.name] for option in options if option.given(typed)}
    aside = None if record is None or record.command is None else record.command.aside
    if aside is not None and aside.seeded in typed:
        typed["seed"] = choices.pop("seed", None)
    # A seed of 0 is a choice as well, and equal to False.
    chosen = any(choices.get(option) is not None and choices[option] is not False for option in KEPT_CHOICES)
    if _takes_stored_options(record, typed) and not chosen:
        # Without options these take those of the run that filled the folder.
        choices |= recall(output)
    calibration = Calibration(campaign, output, make_settings(**choices), progress.update, resume=resume, notice=notice)
    progress.stage(name)
    with _stored_results_doubted(calibration, output):
        return calibration, _computed(record, calibration, typed, resume, notice)


@dataclass(frozen=True)
class _Outcome:
    """What a command computed, which files it wrote aside, and the error whose exit code is its own."""

    result: Any
    written: Sequence[Path] = ()
    fault: type[SysidError] | None = None


def _command(record: Stage[Any] | Ending) -> Command[Any]:
    assert record.command is not None
    return record.command


def _takes_stored_options(record: Stage[Any] | Ending | None, typed: dict[str, Any]) -> bool:
    if record is None:
        return False
    command = _command(record)
    return command.recalls or (command.aside is not None and bool(typed))


def _computed(
    record: Stage[Any] | Ending | None,
    calibration: Calibration,
    typed: dict[str, Any],
    resume: bool,
    notice: Callable[[str], None],
) -> _Outcome:
    """Do what a command is for; None is the whole run."""
    if record is None:
        results = calibration.run()
        return _Outcome(results, fault=None if results.status == "converged" else NotConvergedError)
    if isinstance(record, Ending):
        written = calibration.write(SUMMARY if typed.get("summary") else record)
        if record is not EXPORT:
            calibration.export()
        return _Outcome(written)
    command = _command(record)
    if command.aside is not None and typed:
        aside = calibration.aside(record, typed)
        return _Outcome(aside, calibration.write_aside(record, aside))
    if not resume and record.in_file and isinstance(record, Whole):
        result = calibration.again(record, typed)
    else:
        result = calibration.result(record, typed)
    if stale := calibration.stale_after(record):
        notice(
            f"the results in {calibration.output.name}/ of {', '.join(stale)} are of other inputs or options; the "
            "exported files stay as they are."
        )
    else:
        calibration.export()
    return _Outcome(result, fault=command.fault(result))


def _exit_code(outcome: _Outcome, quick: bool) -> int:
    """0; 3 where the check rejects a channel; 4 where what was asked for has not converged; a preview is 0."""
    if outcome.fault is None or (quick and outcome.fault is NotConvergedError):
        return 0
    return outcome.fault.exit_code


def console(stderr: bool) -> Console:
    """A console that does not squeeze tables into 80 columns when its output goes to a file."""
    console = PlainConsole(stderr=stderr, highlight=False)
    return console if console.is_terminal else PlainConsole(stderr=stderr, highlight=False, width=200, soft_wrap=True)


class PlainConsole(Console):
    """Prints what is asked for, and nothing in it that a terminal would obey: names may come from a stranger."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments of text without control characters; those with which `rich` itself moves the cursor stay."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else plain_text(text), style, control)


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """A polite kill, or a terminal that is closed, counts as Ctrl-C: what is done is kept, and the way to go on said.

    Who starts the program under `nohup` wants it to go on without its terminal: what is ignored stays so.
    """

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    numbers = [n for n in (getattr(signal, name, None) for name in _POLITE) if n is not None]
    numbers = [n for n in numbers if signal.getsignal(n) is not signal.SIG_IGN]
    try:
        before = {number: signal.signal(number, interrupt) for number in numbers}
    except ValueError:  # not in the main thread
        yield
        return
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
