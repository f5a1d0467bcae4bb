"""A stage of the workflow: one record that says how its result is computed, stored, shown and put into the results.

Everything else follows from the records in :mod:`sysid.workflow.stages`: what is stale, the files of an output folder,
the commands, and the contents of the results. The records load quickly: their functions import NumPy or JAX only when
they run, so that the command line shows its help at once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from sysid.display import CommandHint, TextTable
from sysid.errors import SysidError
from sysid.progress import Progress

if TYPE_CHECKING:
    from sysid.campaign.declared import Declared
    from sysid.campaign.records import Campaign
    from sysid.results.contents import Results
    from sysid.workflow.inputs import Inputs
    from sysid.workflow.settings import Settings

T = TypeVar("T")
Notice = Callable[[str], None]
Blocks = Iterable[TextTable | CommandHint | str]


@dataclass(frozen=True)
class Context:
    """The input of the compute function of a stage.

    - `inputs`: the campaign and the hashes of its files;
    - `settings`;
    - `options` of the stage's command by name;
    - `folder`: the output folder;
    - `progress` (message, fraction of the stage), and `notice`: what the user should know;
    - `resume`: whether to continue an interrupted run;
    - `version`: of everything that determines the numbers, by name.

    ``context[FIT]`` is the result of a stage that this one needs, ``context.known(SAMPLE)`` that of one that it uses,
    None where that has not run.
    """

    inputs: Inputs
    settings: Settings
    options: Mapping[str, Any]
    folder: Path
    progress: Progress
    notice: Notice | None
    resume: bool
    version: Mapping[str, str]
    results: Mapping[Stage[Any], Any]

    @property
    def campaign(self) -> Campaign:
        """The campaign with rejected channels removed and clipped samples marked."""
        return self.inputs.campaign

    def __getitem__(self, stage: Stage[T]) -> T:
        result: T = self.results[stage]
        return result

    def known(self, stage: Stage[T]) -> T | None:
        """The result of a stage among the record's `uses`, None where it has not run."""
        result: T | None = self.results[stage]
        return result


@dataclass(frozen=True)
class Option:
    """An option of a command: `flag` as typed, `name` of the value, `kind` of it (bool: a switch).

    `limits` (lowest, highest) of a number, the lowest itself not allowed where `above`; `choices` of a word.
    """

    flag: str
    help: str
    name: str
    kind: type = str
    limits: tuple[float, float] | None = None
    above: bool = False
    choices: tuple[str, ...] = ()
    multiple: bool = False
    required: bool = False
    metavar: str | None = None

    def given(self, options: Mapping[str, Any]) -> bool:
        """Whether the option was typed."""
        return options.get(self.name) not in (None, (), False)


@dataclass(frozen=True)
class Aside(Generic[T]):
    """What a command computes instead when one of its options is given: shown and written, but no part of the results.

    `write` puts it below the output folder, beside the results so far, and returns the files.  With the option
    `seeded`, --seed is one of its own options, and not the seed of the results.
    """

    compute: Callable[[Context], T]
    write: Callable[[T, Results, Path], Sequence[Path]]
    seeded: str = ""


@dataclass(frozen=True)
class Command(Generic[T]):
    """The command of a stage: its help, its options, and how its result is shown.

    - `show` makes tables and sentences;
    - `recalls`: without options the command takes those of the run that filled the folder;
    - `fault` is the error whose exit code the command ends with although the result is shown, None where all is well;
    - `next` are the words of the command that usually comes next on the same campaign;
    - `refuse` raises CampaignError for options that the campaign file alone shows to be wrong: it is called before
      anything is read or computed.
    """

    help: str
    show: Callable[[T, Results], Blocks]
    options: tuple[Option, ...] = ()
    recalls: bool = False
    fault: Callable[[T], type[SysidError] | None] = lambda result: None
    aside: Aside[T] | None = None
    next: tuple[str, ...] = ()
    refuse: Callable[[Declared, Mapping[str, Any]], None] = lambda declared, options: None


def _no_warnings(result: object, quick: bool) -> Sequence[str]:
    return ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Stage(Generic[T]):
    """Base of :class:`Whole` and :class:`Itemwise`.

    - What makes it stale. `needs` are the stages that it depends on, which run first. `uses` are the stages whose
      result it takes if there is one. `settings` are names of settings, ``fit`` or ``fit.laws``. `inputs` are the files
      that it reads, None for all. `code` are the packages whose functions it calls.
    - How it runs: `helper` the modules that a helper process imports to share its work, none for no helper.
    - When it runs: `in_run` whether ``run`` computes it, ``full`` not in previews; `along_with` the stage in whose
      company it always runs; `effort` its typical seconds.
    - How it is kept: `in_file` False for what every process computes anew; `unfinished` whether a kept result goes on
      when an interrupted run is resumed; `answers` whether a kept result fits the options; `so_far` what an
      unfinished run has got; `discard` removes what such a run has left below the output folder.
    - Where it goes: `put` its result into those of the whole calibration (None: under its name into ``further``);
      `warnings` of it (quick: of a preview) for the user; `command` on the command line, None for none.
    """

    name: str
    needs: tuple[Stage[Any], ...] = ()
    uses: tuple[Stage[Any], ...] = ()
    settings: tuple[str, ...] = ()
    inputs: Callable[[Campaign], Collection[str]] | None = None
    code: tuple[str, ...] = ()
    along_with: Stage[Any] | None = None
    in_file: bool = True
    unfinished: Callable[[T, Settings], bool] = lambda result, settings: False
    answers: Callable[[T, Mapping[str, Any]], bool] = lambda result, options: True
    so_far: Callable[[Context], T | None] | None = None
    discard: Callable[[Path], None] | None = None
    put: Callable[[Results, T], Results] | None = None
    warnings: Callable[[T, bool], Sequence[str]] = _no_warnings
    in_run: Literal["always", "full", "never"] = "never"
    effort: float = 1.0
    helper: tuple[str, ...] = ()
    command: Command[Any] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Whole(Stage[T]):
    """A stage with one result; the return annotation of `compute` says what its file may hold."""

    compute: Callable[[Context], T]


@dataclass(frozen=True, eq=False, kw_only=True)
class Itemwise(Stage[dict[str, T]]):
    """A stage whose results are computed one by one, kept one by one, and chosen by name.

    `chosen` returns the names that the options choose; `each` computes the named results in turn, and its return
    annotation says what the file may hold.
    """

    chosen: Callable[[Context], Sequence[str]]
    each: Callable[[Context, Sequence[str]], Iterator[tuple[str, T]]]


@dataclass(frozen=True, kw_only=True)
class Ending:
    """What is written from the results of all stages that have run: ``report``, ``export``.

    `effort` and `helper` as those of a :class:`Stage`.
    """

    name: str
    write: Callable[[Results, Path, Progress], Sequence[Path]]
    command: Command[Any]
    effort: float = 1.0
    helper: tuple[str, ...] = ()
