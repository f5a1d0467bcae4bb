"""Runs a stage after the stages that it needs, each once, and only those whose result is not yet known."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, TypeVar

from sysid.errors import NumericsError
from sysid.helper_process import begin_helper, helped_by, no_helper_after_failure
from sysid.runtime import forget_compiled
from sysid.workflow.inputs import Inputs
from sysid.workflow.progress import Steps
from sysid.workflow.settings import Settings
from sysid.workflow.stage import Context, Ending, Itemwise, Notice, Stage, Whole
from sysid.workflow.stage_folder import StageFolder
from sysid.workflow.stages import DROPS, FIT, STAGES
from sysid.workflow.versions import versions

T = TypeVar("T")
NO_OPTIONS: Mapping[str, Any] = {}
#: The helper process starts before the stage that needs it or, as it imports for a second or two, before the one ahead
#: of that; no earlier, because its memory would add to that of others.
_HELPER_AHEAD = 2


def begin_helper_ahead(coming: Sequence[Stage[Any] | Ending]) -> None:
    """Start the helper of a stage that comes soon, so that it is ready then."""
    begin_helper(next((stage.helper for stage in coming[:_HELPER_AHEAD] if stage.helper), ()))


class Runner:
    """Computes results of stages for one campaign into one output folder.

    Parameters
    ----------
    inputs, settings, folder : what is computed from, and where it is stored. steps : receives all progress. notice :
    callback for what the user should know about a stored chain. resume : whether unfinished results go on.
    """

    def __init__(
        self, inputs: Inputs, settings: Settings, folder: StageFolder, steps: Steps, notice: Notice | None, resume: bool
    ):
        self._inputs, self._settings, self.folder, self.steps = inputs, settings, folder, steps
        self._notice, self.resume = notice, resume
        self._engine_begun = False
        self._again: set[Stage[Any]] = set()
        #: Whether a result has been computed that is kept in a file.
        self.computed = False

    def result(self, stage: Stage[T], options: Mapping[str, Any] = NO_OPTIONS) -> T:
        """The result of a stage: known already, else computed and kept, with those that run along with it."""
        missing = self.missing((stage,), options)
        planned = self.steps.planned({s.name: s.effort for s in missing})
        with planned, no_helper_after_failure(), self.engine_ahead(missing):
            if isinstance(stage, Itemwise):
                # An unknown name is reported before anything is computed, if this needs no computation.
                stage.chosen(self.context(stage, options, at_once=False))
            for number, other in enumerate(missing):
                begin_helper_ahead(missing[number:])
                self._result(other, options if other is stage else NO_OPTIONS)
            return self._result(stage, options)

    @contextmanager
    def engine_ahead(self, missing: Collection[Stage[Any]]) -> Iterator[None]:
        """While missing stages run, compile the engine that they need: without it the first run would wait."""
        if self._engine_begun or not any(stage in missing for stage in (DROPS, FIT)):
            yield
            return
        from sysid.vehicle_model.engine import compiled_ahead

        self._engine_begun = True
        try:
            with compiled_ahead(self._inputs.read.vehicle, parts=FIT in missing):
                yield
        finally:
            self._engine_begun = False

    def known(self, stage: Stage[T]) -> T | None:
        """The result of a stage if it has run on these inputs and settings; one without a file if what it needs has."""
        result = self.folder.known(stage)
        if result is None and not stage.in_file and all(self.known(before) is not None for before in stage.needs):
            result = self._result(stage)
        return result

    def so_far(self, stage: Stage[T]) -> T | None:
        """Results so far of a stage that has not finished; None if there are none."""
        if stage.so_far is None or any(self.known(before) is None for before in stage.needs):
            return None
        return stage.so_far(self.context(stage))

    def again(self, stage: Whole[T], options: Mapping[str, Any] = NO_OPTIONS) -> T:
        """Compute a stage although its result is known; results that depend on it stay if it comes out the same."""
        self._again.add(stage)
        try:
            return self.result(stage, options)
        finally:
            self._again.discard(stage)

    def missing(self, stages: Sequence[Stage[Any]], options: Mapping[str, Any] = NO_OPTIONS) -> list[Stage[Any]]:
        """The stages that have to be computed for some, in an order in which they can be."""
        order: list[Stage[Any]] = []

        def visit(stage: Stage[Any], given: Mapping[str, Any]) -> None:
            if stage in order:
                return
            if self._must_compute(stage, given):
                for before in stage.needs:
                    visit(before, NO_OPTIONS)
                order.append(stage)
            for other in STAGES:
                if other.along_with is stage and (stage in order or self._must_compute(other, NO_OPTIONS)):
                    order.append(other)

        for stage in stages:
            visit(stage, options)
        return order

    def context(self, stage: Stage[Any], options: Mapping[str, Any] = NO_OPTIONS, *, at_once: bool = True) -> Context:
        """What the functions of a stage are given; stages that it needs are computed `at_once` or when asked for."""
        results = _OnDemand(self._result, stage.needs)
        if at_once:
            for before in stage.needs:
                results[before] = self._result(before)
        results |= {before: self.known(before) for before in stage.uses}
        return Context(
            inputs=self._inputs,
            settings=self._settings,
            options=options,
            folder=self.folder.path,
            progress=self.steps,
            notice=self._notice,
            resume=self.resume,
            version=versions(),
            results=results,
        )

    def _must_compute(self, stage: Stage[Any], options: Mapping[str, Any]) -> bool:
        """Whether a stage has to be computed (for an itemwise one: whether anything is requested)."""
        if isinstance(stage, Itemwise):
            return bool(options)
        known = self.folder.known(stage)
        if known is None or stage in self._again:
            return True
        return not stage.answers(known, options) or (self.resume and stage.unfinished(known, self._settings))

    def _result(self, stage: Stage[T], options: Mapping[str, Any] = NO_OPTIONS) -> T:
        if isinstance(stage, Itemwise):
            items: T = self._items(stage, options)
            return items
        assert isinstance(stage, Whole)
        if self._must_compute(stage, options):
            context = self.context(stage, options)
            # What is in memory only may be asked for beside another process that computes.
            with self.folder.lock if stage.in_file else nullcontext():
                helped = helped_by(stage.helper)
                with self._timed(stage.name), self.steps.step(stage.name), breakdown_said(stage.name), helped:
                    result: T = stage.compute(context)
                self.folder.keep(stage, result)
                self._again.discard(stage)
                self.computed = self.computed or stage.in_file
            forget_compiled()
            return result
        known: T | None = self.folder.known(stage)
        assert known is not None
        return known

    def _items(self, stage: Itemwise[Any], options: Mapping[str, Any]) -> Any:
        """The requested items; those of earlier calls are kept, and each new one is stored as soon as it exists."""
        context = self.context(stage, options)
        chosen = stage.chosen(context)
        kept: dict[str, Any] | None = self.folder.known(stage)
        items = dict(kept or {})
        wanted = [name for name in chosen if name not in items]
        if wanted:
            with (
                self.folder.lock,
                self._timed(stage.name),
                self.steps.step(stage.name),
                breakdown_said(stage.name),
            ):
                for name, item in stage.each(context, wanted):
                    items[name] = item
                    self.folder.keep(stage, dict(items))
                    self.computed = True
        return {name: items[name] for name in chosen}

    def _timed(self, name: str) -> AbstractContextManager[None]:
        return self.folder.timed(name, lambda: self.steps.parts)


@contextmanager
def breakdown_said(name: str) -> Iterator[None]:
    """Turn a breakdown of linear algebra inside a stage into a sentence.

    Raises
    ------
    NumericsError
        With what NumPy says, and where to look.
    """
    from numpy.linalg import LinAlgError

    try:
        yield
    except LinAlgError as error:
        why = str(error).strip().rstrip(".") or "a singular matrix"
        raise NumericsError(
            f"The stage '{name}' could not solve its equations ({why}): the data do not determine its unknowns, or a "
            "value is far from that of any vehicle; read what the stage 'check' says of the logs, and compare speeds, "
            "load cases, positions and units in campaign.toml with the test notes."
        ) from error


class _OnDemand(dict[Stage[Any], Any]):
    """Results of the stages that another stage needs, of no others, each computed when it is requested."""

    def __init__(self, compute: Callable[[Stage[Any]], Any], needs: Sequence[Stage[Any]]):
        super().__init__()
        self._compute, self._needs = compute, needs

    def __missing__(self, stage: Stage[Any]) -> Any:
        if stage not in self._needs:
            raise KeyError(f"'{stage.name}' is none of the stages that the record names")
        self[stage] = self._compute(stage)
        return self[stage]
