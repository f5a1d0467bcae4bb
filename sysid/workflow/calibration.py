"""A whole calibration: from a campaign file to results, with the result of each stage stored for later ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from sysid.campaign.findings import QualityReport
from sysid.campaign.records import Campaign, PredictionRequest
from sysid.errors import CampaignError
from sysid.files import write_text
from sysid.helper_process import helped_by
from sysid.output_folder import output_folder
from sysid.progress import Progress
from sysid.results.contents import Results
from sysid.runtime import configure
from sysid.threads import one_blas_thread
from sysid.workflow import stages
from sysid.workflow.assembly import assembled
from sysid.workflow.description import described
from sysid.workflow.earlier_files import remember_more, remove_earlier
from sysid.workflow.inputs import Inputs
from sysid.workflow.progress import Steps
from sysid.workflow.runner import NO_OPTIONS, Runner, begin_helper_ahead, breakdown_said
from sysid.workflow.settings import Settings, make_settings
from sysid.workflow.stage import Aside, Ending, Itemwise, Notice, Stage, Whole
from sysid.workflow.stage_folder import SUCCESS_MARKER, StageFolder, dependents
from sysid.workflow.stages.fit import fit_state

if TYPE_CHECKING:
    from sysid.balance.records import ForceBalance
    from sysid.estimates.calibrated_elements import CalibratedVehicle
    from sysid.estimates.records import Estimates
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.fit.profiles import ProfileLikelihood
    from sysid.estimation.fit.state import FitState
    from sysid.estimation.residuals.run_history import RunHistory
    from sysid.planning.advice_records import Advice
    from sysid.posterior.named_density import NamedDensity
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.prediction.predicted_passes import Predictions
    from sysid.road.road_profile import ScanAnalysis
    from sysid.sdof.drop_results import DropSummary
    from sysid.validation.channel_agreement import Validation

T = TypeVar("T")

#: What the command line calls on a calibration, and nobody else.
_OF_COMMANDS = ("again", "aside", "stale_after", "write_aside")


class Calibration:
    """One campaign and one output folder.

    Every stage method returns its frozen result and stores it under ``stages/`` of the output folder. If a stage has
    already run on the same inputs, its result is read back when a later stage needs it.

    Parameters
    ----------
    campaign : the campaign file or its folder.
    output : folder for everything that is written; made if it does not exist.
    settings : options of the stages.
    quick : a preview with few iterations and a short chain, in place of settings.
    progress : callback (message, fraction of what runs); without one a notebook shows a line below its cell.
    notice : callback for what the user should know about a stored chain.
    resume : continue an interrupted chain, and keep stages whose inputs have not changed even in :meth:`run`.

    Raises
    ------
    ValueError
        If both settings and quick are given.
    CampaignError
        If the campaign file is wrong.
    DataRejectedError
        If a log cannot be read.
    OutputError
        If the output folder cannot be written, or another process computes a stage in it.
    """

    def __init__(
        self,
        campaign: str | Path,
        output: str | Path = "output",
        settings: Settings | None = None,
        progress: Progress | None = None,
        *,
        quick: bool = False,
        resume: bool = False,
        notice: Notice | None = None,
    ):
        if quick and settings is not None:
            raise ValueError("give either settings or quick; make_settings(quick=True) makes settings of a preview")
        configure()
        self.settings = settings or make_settings(quick=quick)
        self.output = output_folder(output)
        self._inputs = Inputs(campaign)
        self._steps = Steps(progress)
        self._folder = StageFolder(self.output, self.settings, self._inputs.read)
        self._runner = Runner(self._inputs, self.settings, self._folder, self._steps, notice, resume)

    def __repr__(self) -> str:
        """One screen: what has run, and k and c of every axle; nothing is computed for it."""
        drops, fit = self._folder.known(stages.DROPS), self._folder.known(stages.FIT)
        finished = [stage.name for stage in stages.STAGES if stage.in_file and self._folder.known(stage) is not None]
        return described(
            self._inputs.read,
            str(self.output),
            finished,
            drops,
            None if fit is None else fit.fit,
            self._folder.known(stages.SAMPLE),
        )

    def __dir__(self) -> list[str]:
        """What a user calls, without what Python adds to every object."""
        return [name for name in super().__dir__() if not name.startswith("_") and name not in _OF_COMMANDS]

    @property
    def campaign(self) -> Campaign:
        """The campaign with rejected channels removed and clipped samples marked."""
        return self._inputs.campaign

    @property
    def read_back(self) -> frozenset[str]:
        """Names of the stages whose results were read from the output folder instead of computed."""
        return frozenset(self._folder.read_back)

    def result(self, stage: Stage[T], options: Mapping[str, Any] = NO_OPTIONS) -> T:
        """The result of any stage; for a stage with several results, the requested ones.

        Parameters
        ----------
        options : the options of the stage's command by name.
        """
        for other in stage.uses:
            if isinstance(other, Itemwise) and options:
                self._runner.result(other, options)
        return self._runner.result(stage, options)

    def aside(self, stage: Stage[T], options: Mapping[str, Any]) -> T:
        """What a stage's command computes instead of its result if its options say so; nothing is stored."""
        other = _aside(stage)
        missing = self._runner.missing(stage.needs)
        with self._steps.planned({s.name: s.effort for s in missing} | {stage.name: stage.effort}):
            # A request that is not possible is reported before anything is computed for it.
            context = self._runner.context(stage, options, at_once=False)
            with self._steps.step(stage.name), breakdown_said(stage.name), one_blas_thread():
                return other.compute(context)

    def write_aside(self, stage: Stage[T], result: T) -> Sequence[Path]:
        """Write what :meth:`aside` computed, and return the files; they are removed with the results it rests on."""
        results = self.results()
        written = _aside(stage).write(result, results, self.output)
        self._folder.write(lambda: remember_more(self.output, stage.name, written))
        self._enter(written, results)
        return written

    def again(self, stage: Whole[T], options: Mapping[str, Any] = NO_OPTIONS) -> T:
        """Compute a stage although its result is known; results that depend on it stay if it comes out the same.

        Parameters
        ----------
        options : the options of the stage's command by name.
        """
        return self._runner.again(stage, options)

    def stale_after(self, stage: Stage[Any]) -> tuple[str, ...]:
        """Names of stages whose stored results belong to other inputs or options, though `stage` has its result.

        Only of those that depend on it if something has been computed: of others older results may be there.
        """
        stale = self._folder.stale()
        after = [other.name for other in dependents(stage)]
        return tuple(name for name in stale if name in after) if self._runner.computed else stale

    def write(self, ending: Ending) -> list[Path]:
        """Write a report or exports from the stages that have run, and return the files.

        Raises
        ------
        CampaignError
            If the folder holds results of other inputs, and nothing has been computed that takes their place: what was
            written from them would be overwritten with nothing.
        """
        stale = () if self._runner.computed else self._folder.stale()
        if stale:
            raise CampaignError(
                f"The results in {self.output.name}/ ({', '.join(stale)}) belong to other inputs or options, or to "
                f"another version of the program: nothing is written. Compute them again with 'run', or "
                "name the campaign and the options that they were made with."
            )
        # Others are over in a moment.
        with self._steps.planned({ending.name: ending.effort} if ending.helper else {}):
            return self._write(ending)

    def _write(self, ending: Ending) -> list[Path]:
        written: list[Path] = []
        with helped_by(ending.helper):
            results = self.results()
            # The step ends first: its last part is timed too.
            with self._folder.timed(ending.name, lambda: self._steps.parts), self._steps.step(ending.name):
                self._folder.write(lambda: written.extend(ending.write(results, self.output, self._steps)))
                self._folder.write(lambda: remove_earlier(self.output, ending.name, written))
                self._enter(written, results)
        return written

    def _enter(self, written: Sequence[Path], results: Results) -> None:
        """Enter files into the list of those that were written of these results."""
        from sysid.export.file_list import remember_files
        from sysid.export.result_json import result_identity

        self._folder.write(lambda: remember_files(self.output, written, result_identity(results)))

    def check(self) -> QualityReport:
        """Quality of every log and channel."""
        return self.result(stages.CHECK)

    def drops(self) -> DropSummary:
        """Stiffness and damping of every axle from its plank drops."""
        return self.result(stages.DROPS)

    def balance(self) -> ForceBalance:
        """Stiffness and damping by the balance of forces, and axle loads, tires and roads of road drives."""
        return self.result(stages.BALANCE)

    def scan(self) -> Mapping[str, ScanAnalysis]:
        """Road profile of every bump."""
        return self.result(stages.SCAN)

    def fit(self) -> FitResult:
        """Least-squares calibration against all bump runs."""
        return self.result(stages.FIT).fit

    def advise(self, speeds_km_h: Sequence[float] = ()) -> Advice:
        """Benefit for k, c and an axle load of one further run at each speed, or of one with one more sensor.

        Without speeds those of :data:`sysid.planning.ranking.CANDIDATE_KM_H`.
        """
        return self.result(stages.ADVISE, {"candidate_speeds": tuple(speeds_km_h)})

    def profile(self, names: Sequence[str]) -> tuple[ProfileLikelihood, ...]:
        """Profiles of the deviance of named parameters, ``k_3`` in every load case; profiles of earlier calls are kept.

        Raises
        ------
        CampaignError
            If the fit has no such parameter.
        """
        return tuple(self.result(stages.PROFILE, {"profiled": tuple(names)}).values())

    def sample(self) -> Posterior:
        """Posterior of the parameters, and with it the bands of :meth:`histories`.

        If an interrupted chain is to be continued, a chain that has not converged and is shorter than the limit is
        continued too.
        """
        return self.result(stages.SAMPLE)

    def density(self) -> NamedDensity:
        """The density that :meth:`sample` draws from as a function of values, and what they simulate.

        For residuals, priors, optimisers and samplers of somebody's own; the fit runs first.
        """
        from sysid.posterior.named_density import NamedDensity

        histories = self.fit().histories
        return NamedDensity(fit_state(self._runner.context(stages.SAMPLE, {}, at_once=False)), histories)

    def histories(self) -> tuple[RunHistory, ...]:
        """Measured against simulated histories of every run, with posterior bands where it has been sampled."""
        from sysid.prediction.run_bands import with_bands

        histories, bands = self.fit().histories, self._runner.known(stages.BANDS)
        return histories if bands is None else with_bands(histories, bands)

    def predict(
        self,
        speed_km_h: float | Sequence[float] | None = None,
        *,
        load_case: str | None = None,
        bump: str | None = None,
        road: str | None = None,
        length_m: float | None = None,
        bridge: str | None = None,
        vehicles: int | None = None,
        gap_m: float | None = None,
        realisations: int | None = None,
    ) -> Predictions:
        """Axle loads from the posterior if there is one: of the campaign's passes, or of others at the given speeds.

        Others are no part of the results; :func:`sysid.export.tables.write_passes` writes them.

        Parameters
        ----------
        speed_km_h : one speed or several [km/h]; without it the passes that the campaign requests.
        load_case : load case of the speeds, the first if not given.
        bump : a scan of the campaign, or a file with a profile; the first scan if not given.
        road : a class of ISO 8608 (A to H) or a file with a measured profile, in place of a bump.
        length_m : length of the road [m].
        bridge : a bridge of the campaign or a TOML file with its keys, in place of a bump; `road` is then the class of
            its surface.
        vehicles, gap_m : equal vehicles one behind the other on the bridge, and from the last axle of one to the first
            of the next [m].
        realisations : how many roads or surfaces of the class are driven.

        Raises
        ------
        CampaignError
            If the campaign has no such load case or bump, or options are given without a speed.
        """
        options = {"load_case": load_case, "bump": bump, "road": road, "length": length_m, "bridge": bridge}
        options |= {"vehicles": vehicles, "gap": gap_m, "realisations": realisations}
        given = {name: value for name, value in options.items() if value is not None}
        if speed_km_h is None:
            if given:
                raise CampaignError(f"predict({next(iter(given))}=...) needs a speed: give speed_km_h, for example 60.")
            return self.result(stages.PREDICT)
        speeds = (speed_km_h,) if isinstance(speed_km_h, int | float) else tuple(speed_km_h)
        return self.aside(stages.PREDICT, {"speeds": speeds, "seed": self.settings.seed, **given})

    def predict_passes(self, requests: Sequence[PredictionRequest]) -> Predictions:
        """Axle loads of other passes than those of the campaign file, from the posterior if there is one.

        They are no part of the results; :func:`sysid.export.tables.write_passes` writes them.
        """
        return self.aside(stages.PREDICT, {"requests": tuple(requests)})

    def validate(self) -> Validation:
        """Agreement of simulated and measured histories of the fitted runs, and of runs left out so far."""
        return self.result(stages.VALIDATE)

    def leave_out(self, runs: Sequence[str] = ()) -> Validation:
        """Predict `runs` (all if none is named), each by a fit of all other runs; earlier results are kept.

        The fits take the suspension laws and the drops of the fit of all runs.
        """
        return self.result(stages.VALIDATE, {"left_out": tuple(runs), "leave_one_out": not runs})

    def finished_fit(self) -> tuple[FitResult, FitState]:
        """Results of the fit, and the point from which later stages start, read back; nothing is computed.

        Raises
        ------
        CampaignError
            If the output folder holds no fit of this campaign file with these settings.
        """
        from sysid.workflow.stages.fit import fit_state

        known = self._runner.known(stages.FIT)
        if known is None:
            raise CampaignError(
                f"{self.output.name}/ holds no fit of {self._inputs.read.file.name} as that file and its logs are now; "
                "name the campaign file of the folder, or run 'fit' again."
            )
        return known.fit, fit_state(self._runner.context(stages.LEFT_OUT))

    def vehicles(self) -> tuple[CalibratedVehicle, ...]:
        """The calibrated vehicle of every load case with data, at the posterior medians if there are any.

        A load case that nobody drove has none where stiffness belongs to a load case.
        """
        self.fit()
        return self.estimates().vehicles

    def estimates(self) -> Estimates:
        """Results for the truck from the stages so far: k and c per axle, modes, suspension curves, effective roads."""
        return self.result(stages.ESTIMATES)

    def report(self) -> Path:
        """Write report.html from the stages that have run, and figures/: the paper's figures of this campaign."""
        return self.write(stages.REPORT)[0]

    def summary(self) -> Path:
        """Write summary.pdf, one page to print and sign, from the stages that have run."""
        return self.write(stages.SUMMARY)[0]

    def export(self) -> list[Path]:
        """Write result.json, tables, posterior.nc and files for other programs from the stages that have run."""
        return self.write(stages.EXPORT)

    def run(self) -> Results:
        """All stages in order, then exports, report and the success marker, which is written last."""
        kinds = ("always",) if self.settings.quick else ("always", "full")
        wanted = [stage for stage in stages.STAGES if stage.in_run in kinds]
        with self._folder.lock:
            self._folder.no_success()
            self._folder.tidy()
            if not self._runner.resume:
                self._folder.clear()
            missing = self._runner.missing(wanted)
            efforts = {stage.name: stage.effort for stage in missing}
            planned = self._steps.planned(efforts | {ending.name: ending.effort for ending in stages.ENDINGS})
            with planned, self._runner.engine_ahead(missing):
                for stage in wanted:
                    if stage in missing:
                        begin_helper_ahead((*missing[missing.index(stage) :], *stages.ENDINGS))
                    self._runner.result(stage)
                for ending in stages.ENDINGS:
                    self._write(ending)
            results = self.results()
            self._folder.write(lambda: write_text(self.output / SUCCESS_MARKER, f"{results.status}\n"))
        return results

    def results(self) -> Results:
        """Everything that has been computed so far for these inputs and settings."""
        return assembled(self._runner, self._inputs, self.settings)


def _aside(stage: Stage[T]) -> Aside[T]:
    assert stage.command is not None
    other: Aside[T] | None = stage.command.aside
    assert other is not None
    return other
