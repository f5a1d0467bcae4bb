"""Settings of a whole calibration."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast, get_args

from sysid.errors import CampaignError
from sysid.estimation.fit.options import FitOptions
from sysid.files import read_json, write_text
from sysid.posterior.options import SamplingOptions
from sysid.road.contact_laws import ContactLaw
from sysid.validation.channel_agreement import ValidationLimits
from sysid.wording import finish, nearest, shorten


@dataclass(frozen=True)
class Settings:
    """Options of the stages; `quick` gives a preview with few iterations and a short chain, marked as such.

    `drop_model` says whether the plank drops are fitted by the full vehicle model too; `validation` holds the limits
    that an acceptable channel keeps.
    """

    fit: FitOptions = field(default_factory=FitOptions)
    sampling: SamplingOptions = field(default_factory=SamplingOptions)
    quick: bool = False
    drop_model: bool = True
    validation: ValidationLimits = field(default_factory=ValidationLimits)

    @property
    def seed(self) -> int:
        """Seed of everything random."""
        return self.sampling.seed

    def as_dict(self) -> dict[str, Any]:
        """Plain nested mapping, for the provenance."""
        return asdict(self)


#: How the suspension laws of axles without a declared one may be found.
LAWS = ("auto", "compare", "declared")
#: Choices of the command line that a later report of the same folder takes over.
KEPT_CHOICES = {"quick": bool, "seed": int, "laws": str, "contact": str, "contact_spread": bool}


_DATE = "date"


def remember(folder: Path, settings: Settings) -> None:
    """Store the choices of the command line, so that a later report of the same folder uses them, and the time."""
    known = {**asdict(settings.fit), "quick": settings.quick, "seed": settings.seed}
    date = datetime.now(UTC).isoformat(timespec="seconds")
    kept = {name: known[name] for name in KEPT_CHOICES} | {_DATE: date}
    write_text(folder / "stages" / "settings.json", json.dumps(kept))


def date_of(folder: Path) -> str:
    """When the last stage was computed in an output folder (ISO 8601, UTC); empty where that is not known."""
    date = read_json(folder / "stages" / "settings.json").get(_DATE)
    try:
        return datetime.fromisoformat(date).isoformat(timespec="seconds") if isinstance(date, str) else ""
    except ValueError:
        return ""


def recall(folder: Path) -> dict[str, Any]:
    """What :func:`remember` stored in an output folder; empty if nothing was stored or it cannot be read."""
    try:
        kept = read_json(folder / "stages" / "settings.json")
        choices = {name: kept[name] for name, kind in KEPT_CHOICES.items() if type(kept[name]) is kind}
        known = choices["laws"] in LAWS and choices["contact"] in get_args(ContactLaw) and choices["seed"] >= 0
    except (KeyError, TypeError):
        return {}
    return choices if known and len(choices) == len(KEPT_CHOICES) else {}


def make_settings(
    *,
    quick: bool = False,
    seed: int | None = None,
    max_steps: int | None = None,
    laws: str | None = None,
    contact: str | None = None,
    contact_spread: bool = False,
) -> Settings:
    """Settings from the options of the command line.

    Raises
    ------
    CampaignError
        If there is no such way to find laws, or no such contact law.
    """
    for name, given, known in (("laws", laws, LAWS), ("contact", contact, get_args(ContactLaw))):
        if given is not None and given not in known:
            raise CampaignError(finish(f"{name}='{shorten(given)}' is not known; {nearest(given, known)}"))
    seed = SamplingOptions.seed if seed is None else seed
    settings = Settings(sampling=replace(SamplingOptions(), seed=seed))
    if quick:
        settings = Settings(
            fit=FitOptions(
                weight_rounds=1,
                second_solver=False,
                tolerance=1e-5,
                max_iterations=20,
                target_step_s=0.0025,
                preview=True,
            ),
            sampling=SamplingOptions(segment_steps=10, min_steps=10, max_steps=10, seed=seed, preview=True),
            quick=True,
        )
    if laws is not None:
        settings = replace(settings, fit=replace(settings.fit, laws=laws))
    if contact_spread:
        settings = replace(settings, fit=replace(settings.fit, contact_spread=True))
    if contact is not None:
        settings = replace(settings, fit=replace(settings.fit, contact=cast(ContactLaw, contact)))
    if max_steps is not None:
        settings = replace(settings, sampling=replace(settings.sampling, max_steps=max_steps))
    return settings
