"""The order of the stages: from a campaign file to results, each stage kept in the output folder for the next."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from sysid.campaign.findings import QualityReport
from sysid.campaign.quality import check_quality
from sysid.campaign.read import read_campaign
from sysid.campaign.records import Campaign, PredictionRequest
from sysid.campaign.wording import finish, nearest
from sysid.errors import CampaignError, DataRejectedError
from sysid.estimation.fit.drop_model import with_model_estimates
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.law_choice import check_priors, fit_with_laws
from sysid.estimation.fit.profiles import ProfileLikelihood, profile_parameter
from sysid.estimation.fit.state import FitPoint, FitState, restored
from sysid.estimation.residuals.run_history import HistoryBand, RunHistory
from sysid.export.contents import Results, Status
from sysid.export.files import write_text
from sysid.export.inference_data import write_posterior
from sysid.export.models import write_models
from sysid.export.result_json import write_result
from sysid.export.tables import write_parameters, write_predictions, write_profiles, write_validation
from sysid.planning.advice import Advice
from sysid.planning.advise import CANDIDATE_KM_H, advise
from sysid.posterior.cross_check import CrossCheck, cross_check
from sysid.posterior.log_density import LIKELIHOOD, LogDensity
from sysid.posterior.results import Posterior
from sysid.posterior.sampling import chain_identity, posterior_so_far, sample_posterior
from sysid.prediction.calibrated import calibrated_vehicle
from sysid.prediction.calibrated_elements import CalibratedVehicle
from sysid.prediction.driven import run_bands, with_bands
from sysid.prediction.passes import SWEEP_KM_H, predict
from sysid.prediction.results import Predictions
from sysid.road.point_cloud import read_point_cloud
from sysid.road.profile_files import bump_from_file
from sysid.road.results import RoadProfile, ScanAnalysis
from sysid.road.scan import analyse_scan
from sysid.runtime import configure
from sysid.sdof.results import DropSummary
from sysid.sdof.summary import analyse_drops
from sysid.validation.agreement import validate
from sysid.validation.leave_out import chosen_runs, leave_out
from sysid.validation.results import LeftOut, LeftOutRun, Validation
from sysid.vehicle_model.engine import engine_name
from sysid.workflow.settings import Settings
from sysid.workflow.stage_folder import STAGES, SUCCESS_MARKER, StageFolder
from sysid.workflow.versions import versions

Progress = Callable[[str, float], None]
Notice = Callable[[str], None]


class Calibration:
    """One campaign and one output folder.

    Every stage method returns its frozen result and keeps it under ``stages/`` of the output folder; a stage that has
    already run on the same inputs is read back instead of run again when a later one needs it.

    Parameters
    ----------
    campaign : the campaign file or its folder.
    output : folder for everything that is written; made if it does not exist.
    settings : options of the stages.
    progress : callback (message, fraction of the running stage).
    notice : callback for what the user should know about a stored chain.
    resume : continue an interrupted chain, and keep stages whose inputs have not changed even in :meth:`run`.

    Raises
    ------
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
        resume: bool = False,
        notice: Notice | None = None,
    ):
        configure()
        self.settings = settings or Settings()
        self.output = Path(output)
        self._progress = progress or (lambda message, fraction: None)
        self._notice = notice
        self._resume = resume
        self._raw = read_campaign(campaign, point_cloud_reader=read_point_cloud, profile_reader=bump_from_file)
        check_priors(self._raw)
        self._stages = StageFolder(self.output, self.settings, self._raw.input_sha256)
        self._screened: tuple[Campaign, QualityReport] | None = None
        self._validated: tuple[FitResult, Validation] | None = None

    # ------------------------------------------------------------------ stages

    def check(self) -> QualityReport:
        """Quality of every log and channel."""
        report: QualityReport = self._stages.result("check", lambda: self._screen()[1])
        return report

    @property
    def campaign(self) -> Campaign:
        """The campaign with rejected channels removed and clipped samples marked."""
        return self._screen()[0]

    def drops(self) -> DropSummary:
        """Stiffness and damping of every axle from its plank drops."""
        return self._stages.result("drops", self._drops)

    def scan(self) -> Mapping[str, ScanAnalysis]:
        """Road profile of every bump."""
        return self._stages.result("scan", lambda: {name: analyse_scan(s) for name, s in self.campaign.scans.items()})

    def fit(self) -> FitResult:
        """Least-squares calibration against all bump runs."""
        result: FitResult = self._stages.result("fit", self._fit)[0]
        return result

    def advise(self, speeds_km_h: Sequence[float] = CANDIDATE_KM_H) -> Advice:
        """What one further run at each speed, or one with one more sensor, would bring for k, c and a wheel load."""
        known: Advice | None = self._stages.known("advise")
        found = () if known is None else known.runs
        others = {f"{3.6 * p.speed_m_s:.6g}" for p in found} != {f"{v:.6g}" for v in speeds_km_h}
        return self._stages.result("advise", lambda: self._advise(speeds_km_h), again=others)

    def profile(self, names: Sequence[str]) -> tuple[ProfileLikelihood, ...]:
        """Profiles of the deviance of named parameters, ``k_3`` in every load case; those of earlier calls are kept.

        Raises
        ------
        CampaignError
            If the fit has no such parameter.
        """
        chosen: list[str] = []
        for name in names:
            # k_3 stands for the stiffness of axle 3 in every load case.
            chosen += [n for n in self.fit().names if n == name or n.startswith(f"{name}[")]
            if not any(n == name or n.startswith(f"{name}[") for n in chosen):
                raise CampaignError(finish(f"The fit has no parameter '{name}'; {nearest(name, self.fit().names)}"))
        found: dict[str, ProfileLikelihood] = dict(self._stages.known("profile") or {})
        wanted = [name for name in dict.fromkeys(chosen) if name not in found]
        with self._stages.lock:
            for name, profile in self._profiled(wanted):
                # Kept one by one: a profile takes minutes.
                found[name] = profile
                self._stages.keep("profile", dict(found))
        return tuple(found[name] for name in dict.fromkeys(chosen))

    def sample(self) -> Posterior:
        """Posterior of the parameters, and with it the bands of :meth:`histories`.

        When an interrupted chain is to be continued, so is one that has not converged and is shorter than the limit.
        """
        known: Posterior | None = self._stages.known("sample")
        steps = 0 if known is None else known.burn_in + known.thin * known.draws.shape[1]
        unfinished = known is not None and not known.converged and steps < self.settings.sampling.max_steps
        posterior: Posterior = self._stages.result("sample", self._sample, again=self._resume and unfinished)
        self._stages.result("bands", lambda: self._bands(posterior))
        return posterior

    def crosscheck(self) -> CrossCheck:
        """The posterior sampled once more by a gradient-based sampler, and compared.

        Raises
        ------
        CampaignError
            If that sampler is not installed.
        """
        return self._stages.result("crosscheck", self._crosscheck)

    def histories(self) -> tuple[RunHistory, ...]:
        """Measured against simulated histories of every run, with posterior bands where it has been sampled."""
        return self._with_bands(self.fit()).histories

    def predict(self) -> Predictions:
        """Wheel loads of the passes that the campaign asks for, from the posterior if there is one."""
        return self._stages.result("predict", self._predict)

    def validate(self) -> Validation:
        """Agreement of simulated and measured histories of the fitted runs, and of runs left out so far."""
        fit = self.fit()
        # The rating takes seconds and is asked for by report and export alike.
        if self._validated is None or self._validated[0] is not fit:
            self._validated = fit, validate(fit, self.settings.validation)
        found = self._validated[1]
        left: tuple[LeftOutRun, ...] = self._stages.known("left_out") or ()
        return replace(found, left_out=LeftOut(fit.names, left, found.channels)) if left else found

    def leave_out(self, runs: Sequence[str] = ()) -> Validation:
        """Predict `runs` (all for none named), each by a fit of all other runs; what is done already is kept.

        The fits take the suspension laws and the drops of the fit of all runs.
        """
        chosen = chosen_runs(self.campaign, runs)
        fit, state = self.fit(), self._state()
        done = {left.run: left for left in self._stages.known("left_out") or ()}
        todo = [run for run in chosen if run not in done]
        options, report = self.settings.fit, self._progress
        for left in leave_out(fit, state, todo, options, report):
            done[left.run] = left
            kept = tuple(done[r.log.file] for r in self.campaign.bump_runs if r.log.file in done)
            with self._stages.lock:
                self._stages.keep("left_out", kept)
        return self.validate()

    def vehicles(self) -> tuple[CalibratedVehicle, ...]:
        """The calibrated vehicle of every load case that the data speak of, at the posterior medians if there are any.

        A load case that nobody drove has none where stiffness belongs to a load case.
        """
        drops, fit, posterior = self.drops(), self.fit(), self._stages.known("sample")
        found = []
        for name in self.campaign.load_cases:
            try:
                found.append(calibrated_vehicle(self.campaign, drops, fit, posterior, name))
            except KeyError:
                continue
        return tuple(found)

    def report(self) -> Path:
        """Write report.html from the stages that have run, and figures/: the paper's figures of this campaign."""
        from sysid.report import write_paper_figures, write_report

        path, results = self.output / "report.html", self.results()
        self._stages.timed("report", lambda: self._stages.write(lambda: write_report(results, path)))
        self._stages.timed(
            "figures", lambda: self._stages.write(lambda: write_paper_figures(results, self.output / "figures"))
        )
        return path

    def export(self) -> list[Path]:
        """Write result.json, tables, posterior.nc and files for other programs from the stages that have run."""
        results = self.results()
        written: list[Path] = []
        self._stages.write(lambda: written.extend(self._exported(results)))
        return written

    def _exported(self, results: Results) -> list[Path]:
        written = [self.output / "result.json"]
        if results.fit is not None:
            write_parameters(results, self.output / "parameters.csv")
            write_validation(results, self.output / "validation.csv")
            written += [self.output / "parameters.csv", self.output / "validation.csv"]
            written += write_models(results.campaign, self.vehicles(), results.predictions, self.output)
        written += write_profiles(results.profiles, self.output)
        if results.predictions is not None:
            written += write_predictions(results, self.output)
        if results.posterior is not None:
            write_posterior(results, self.output / "posterior.nc")
            written.append(self.output / "posterior.nc")
        write_result(results, self.output / "result.json")
        return written

    def run(self) -> Results:
        """All stages in order, then exports, report and the success marker, which is written last."""
        with self._stages.lock:
            return self._run()

    def _run(self) -> Results:
        (self.output / SUCCESS_MARKER).unlink(missing_ok=True)
        if not self._resume:
            self._stages.forget(STAGES)
        for stage in (self.check, self.drops, self.scan, self.fit, self.sample, self.predict):
            stage()
        if not self.settings.quick:
            self.advise()
        self.report()
        self.export()
        results = self.results()
        write_text(self.output / SUCCESS_MARKER, f"{results.status}\n")
        return results

    # ------------------------------------------------------------------ results

    def results(self) -> Results:
        """Everything that has been computed so far for these inputs and settings."""
        found = {name: self._stages.known(name) for name in STAGES}
        fit = self._with_bands(found["fit"][0]) if found["fit"] is not None else None
        posterior: Posterior | None = found["sample"]
        if posterior is None and found["fit"] is not None:
            posterior = self._sampled_so_far(*found["fit"])
        return Results(
            campaign=self.campaign,
            quality=found["check"],
            drops=found["drops"],
            scans=found["scan"] or {},
            fit=fit,
            posterior=posterior,
            crosscheck=found["crosscheck"],
            predictions=found["predict"],
            advice=found["advise"],
            profiles=tuple((found["profile"] or {}).values()),
            validation=None if fit is None else self.validate(),
            status=self._status(fit, posterior),
            warnings=self._warnings(posterior),
            provenance={
                "input_sha256": dict(self._raw.input_sha256),
                # Building an engine takes time: its name is known where one has been used.
                "versions": versions() | ({} if fit is None else {"engine": engine_name()}),
                "seed": self.settings.seed,
                "settings": self.settings.as_dict(),
                "timings": {name: round(seconds, 3) for name, seconds in self._stages.timings.items()},
            },
        )

    def _status(self, fit: FitResult | None, posterior: Posterior | None) -> Status:
        if self.settings.quick:
            return "preview"
        done = fit is not None and fit.converged and posterior is not None and posterior.converged
        return "converged" if done else "not_converged"

    def _warnings(self, posterior: Posterior | None) -> tuple[str, ...]:
        found = [*self._raw.messages]
        quality: QualityReport | None = self._stages.known("check")
        if quality is not None:
            found += quality.messages
            found += [
                f"{f.file}, {f.column} was left out: {' '.join(f.messages)}"
                for f in quality.channels
                if f.verdict == "rejected"
            ]
        unfinished = posterior is not None and self._stages.known("sample") is None
        if self.settings.quick:
            found.append("Preview: few iterations and a short chain; run without --quick before using any number.")
        elif posterior is None:
            found.append("The posterior has not been sampled: there are no credible intervals yet.")
        if posterior is not None:
            if unfinished or not (posterior.converged or self.settings.quick):
                found.append(posterior.message)
            found += posterior.warnings
        checked: CrossCheck | None = self._stages.known("crosscheck")
        if checked is not None and not checked.agrees:
            found.append(checked.message)
        return tuple(found)

    # ------------------------------------------------------------------ how stages work

    def _drops(self) -> DropSummary:
        summary = analyse_drops(self.campaign)
        if not self.settings.drop_model or not self.campaign.plank_drops:
            return summary
        options = replace(self.settings.fit, weight_rounds=1, tolerance=1e-4)
        return with_model_estimates(self.campaign, summary, options, self._progress)

    def _fit(self) -> tuple[FitResult, FitPoint]:
        if not self.campaign.bump_runs:
            raise DataRejectedError(
                "No bump run is left to fit: every log was rejected or none is listed; see the stage 'check'."
            )
        fit, state = fit_with_laws(self.campaign, self.drops(), self._profiles(), self.settings.fit, self._progress)
        return fit, state.point

    def _state(self) -> FitState:
        point: FitPoint = self._stages.result("fit", self._fit)[1]
        return restored(self.campaign, self._profiles(), point)

    def _advise(self, speeds_km_h: Sequence[float]) -> Advice:
        determined, state = self.fit().identifiability, self._state()
        assert determined is not None
        return advise(state, determined, speeds_km_h=speeds_km_h, progress=self._progress)

    def _profiled(self, names: Sequence[str]) -> Iterator[tuple[str, ProfileLikelihood]]:
        if not names:
            return
        fit, state = self.fit(), self._state()
        for name in names:
            compute = partial(profile_parameter, state, fit, name, progress=self._progress)
            yield name, self._stages.timed("profile", compute)

    def _sample(self) -> Posterior:
        fit, state = self.fit(), self._state()
        density = LogDensity(state)
        return sample_posterior(
            density,
            fit.names,
            state.point.log_parameters,
            fit.covariance,
            LIKELIHOOD,
            self.settings.sampling,
            folder=self.output / "chain",
            fingerprint=self._chain_inputs(),
            resume=self._resume,
            progress=self._progress,
            notice=self._notice,
        )

    def _bands(self, posterior: Posterior) -> tuple[HistoryBand, ...]:
        draws = np.log(posterior.draws.reshape(-1, len(posterior.names)))
        return run_bands(self._state(), draws, seed=self.settings.seed, progress=self._progress)

    def _with_bands(self, fit: FitResult) -> FitResult:
        bands: tuple[HistoryBand, ...] | None = self._stages.known("bands")
        return fit if bands is None else replace(fit, histories=with_bands(fit.histories, bands))

    def _crosscheck(self) -> CrossCheck:
        fit, posterior, state = self.fit(), self.sample(), self._state()
        density = LogDensity(state)
        return cross_check(
            density.gradient,
            posterior,
            state.point.log_parameters,
            fit.covariance,
            seed=self.settings.seed,
            progress=self._progress,
        )

    def _sampled_so_far(self, fit: FitResult, point: FitPoint) -> Posterior | None:
        """Draws of a chain that another process is still adding to, or that was stopped."""
        options = self.settings.sampling
        identity = chain_identity(options, point.log_parameters, fit.covariance, self._chain_inputs())
        return posterior_so_far(self.output / "chain", identity, fit.names, LIKELIHOOD, options)

    def _chain_inputs(self) -> dict[str, str]:
        """What the draws depend on besides the settings: files, engine and versions."""
        files = {f"file {name}": digest for name, digest in self._raw.input_sha256.items()}
        found = versions()
        used = {f"version of {name}": found[name] for name in ("sysid", "numpy", "jaxlib", "emcee")}
        return {**files, **used, "engine": engine_name()}

    def predict_passes(self, requests: Sequence[PredictionRequest]) -> Predictions:
        """Wheel loads of other passes than those of the campaign file, from the posterior if there is one.

        They are no part of the results; :func:`sysid.export.write_predictions` writes them.
        """
        return self._predict(tuple(requests), sweep_km_h=())

    def _predict(
        self, requests: tuple[PredictionRequest, ...] | None = None, sweep_km_h: Sequence[float] = SWEEP_KM_H
    ) -> Predictions:
        posterior: Posterior | None = self._stages.known("sample")
        draws = None if posterior is None else np.log(posterior.draws.reshape(-1, len(posterior.names)))
        return predict(
            self._state(),
            draws,
            self.campaign.predictions if requests is None else requests,
            seed=self.settings.seed,
            sweep_km_h=() if self.settings.quick else sweep_km_h,
            progress=self._progress,
        )

    def redo(self, name: str) -> None:
        """Forget a stage and all that follow, so that it runs again."""
        self._stages.redo(name)

    def _profiles(self) -> dict[str, RoadProfile]:
        return {name: analysis.profile for name, analysis in self.scan().items()}

    def _screen(self) -> tuple[Campaign, QualityReport]:
        if self._screened is None:
            self._screened = check_quality(self._raw)
        return self._screened
