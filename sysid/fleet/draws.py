"""The record of one campaign for its fleet: thinned draws of the log parameters, and the prior they were made under."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid import array_file

if TYPE_CHECKING:
    from sysid.results.contents import Results
    from sysid.workflow import Calibration

RECORD_FILE = "fleet_draws.npz"
#: Draws of the same campaign under what the other trucks say of it (:mod:`sysid.fleet.resample`).
POPULATION_RECORD_FILE = "fleet_draws_population.npz"
#: Draws that are kept of a campaign: enough for a Pareto k, few enough for ten thousand campaigns.
KEPT_DRAWS = 1000
#: Version of the stored draws; others are not read.
SCHEMA = 1
#: Logarithms of numbers that a float holds are far below.
_LARGEST = 1e4
_WORDS = ("names", "quantities", "units", "axles", "load_cases", "laws")


@dataclass(frozen=True)
class CampaignDraws:
    """Draws (n, p) of the log parameters of one campaign, and the Gaussian prior N(prior_mean, prior_covariance).

    `names`, `quantities`, `units`, suspension `laws` of the parameters; `axles` from 0, -1 for a property of all;
    `load_cases` empty where a value holds in all of them.
    """

    names: tuple[str, ...]
    quantities: tuple[str, ...]
    units: tuple[str, ...]
    axles: tuple[int, ...]
    load_cases: tuple[str, ...]
    laws: tuple[str, ...]
    draws: np.ndarray
    prior_mean: np.ndarray
    prior_covariance: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.names)
        for words in (self.quantities, self.units, self.axles, self.load_cases, self.laws):
            if len(words) != count:
                raise ValueError("as many quantities, units, axles, load cases and laws as names are expected")
        if self.draws.ndim != 2 or self.draws.shape[1] != count or self.prior_mean.shape != (count,):
            raise ValueError(f"draws (n, {count}) and a prior mean ({count},) are expected")
        if self.prior_covariance.shape != (count, count):
            raise ValueError(f"a prior covariance ({count}, {count}) is expected")

    def of(self, names: tuple[str, ...]) -> CampaignDraws:
        """The same of some of the parameters: the prior of a part of a Gaussian vector is the part of the prior."""
        at = [self.names.index(name) for name in names]
        return CampaignDraws(
            names,
            tuple(self.quantities[i] for i in at),
            tuple(self.units[i] for i in at),
            tuple(self.axles[i] for i in at),
            tuple(self.load_cases[i] for i in at),
            tuple(self.laws[i] for i in at),
            self.draws[:, at],
            self.prior_mean[at],
            self.prior_covariance[np.ix_(at, at)],
        )


def thinned(draws: np.ndarray, most: int = KEPT_DRAWS) -> np.ndarray:
    """At most `most` rows of draws (n, p), evenly spaced."""
    if len(draws) <= most:
        return draws
    return np.asarray(draws[np.linspace(0, len(draws) - 1, most).astype(int)])


def write_record(calibration: Calibration, results: Results, output: Path) -> None:
    """Keep the draws of a finished calibration for its fleet; nothing where there are none."""
    from sysid.workflow.stages.fit import FIT
    from sysid.workflow.stages.posterior import log_draws

    if results.posterior is None or results.fit is None:
        return
    parameters = calibration.result(FIT).point.parameters
    rows, targets = parameters.prior_rows()
    covariance = np.linalg.inv(rows.T @ rows)
    of = parameters.parameters
    write_draws(
        output / RECORD_FILE,
        CampaignDraws(
            parameters.names,
            tuple(p.quantity for p in of),
            tuple(p.unit for p in of),
            tuple(-1 if p.axle is None else p.axle for p in of),
            tuple(p.load_case or "" for p in of),
            tuple(p.law for p in of),
            thinned(log_draws(results.posterior)),
            covariance @ rows.T @ targets,
            covariance,
        ),
    )


def record_digest(folder: Path) -> str:
    """Hash of the record of the campaign whose results are in a folder; empty where there is none."""
    return array_file.digest_of(folder / RECORD_FILE) or ""


def campaign_draws(folder: Path, digest: str = "") -> CampaignDraws | None:
    """The draws of the campaign whose results are in a folder; None where there are none.

    Those under the population are taken if they were made from the campaign's present record.

    Parameters
    ----------
    digest : hash of the record that is expected, empty for any.
    """
    again = array_file.read(folder / POPULATION_RECORD_FILE)
    if again is not None and again.fields.get("of") == (digest or record_digest(folder)):
        record = _decoded(again)
        if record is not None:
            return record
    return read_draws(folder / RECORD_FILE, digest)


def write_draws(path: Path, record: CampaignDraws, of: str = "") -> None:
    """Write a record, complete or not at all; `of` is the hash of the record that it replaces.

    Raises OSError if the folder cannot be written.
    """
    fields: dict[str, Any] = {"schema": SCHEMA, "of": of, **{name: getattr(record, name) for name in _WORDS}}
    arrays = {"draws": record.draws, "prior_mean": record.prior_mean, "prior_covariance": record.prior_covariance}
    array_file.write(path, fields, arrays)


def read_draws(path: Path, digest: str = "") -> CampaignDraws | None:
    """What :func:`write_draws` left; None where there is nothing, or it is damaged, of another schema or hash.

    Parameters
    ----------
    digest : hash of the record that is expected, empty for any.
    """
    content = array_file.read(path)
    return None if content is None or digest not in ("", content.digest) else _decoded(content)


def _decoded(content: array_file.Content) -> CampaignDraws | None:
    if content.fields.get("schema") != SCHEMA:
        return None
    try:
        words: dict[str, Any] = {k: tuple(content.fields[k]) for k in _WORDS}
        arrays: dict[str, Any] = dict(content.arrays)
        record = CampaignDraws(**words, **arrays)
    except (KeyError, TypeError, ValueError):
        return None
    kinds = {name: int if name == "axles" else str for name in _WORDS}
    typed = all(type(word) is kinds[name] for name in _WORDS for word in words[name])
    # Logarithms and their covariances; not a number is not below either.
    numbers = all(array.dtype == float and (np.abs(array) < _LARGEST).all() for array in arrays.values())
    return record if typed and numbers and len(set(record.names)) == len(record.names) else None
