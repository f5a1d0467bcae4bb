"""From the folders of a fleet to what its populations are computed from, one campaign in memory at a time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from sysid.errors import DataRejectedError
from sysid.fleet.draws import CampaignDraws, campaign_draws
from sysid.fleet.hierarchy import HyperPriors, TypeData
from sysid.fleet.likelihood import Likelihood, likelihood_of, without_shared
from sysid.fleet.members import Member, Members
from sysid.fleet.population import TypePopulation, fit_population, stand_alone
from sysid.fleet.records import SharedError
from sysid.numbers import listing
from sysid.progress import Progress, unwatched
from sysid.threads import one_blas_thread

#: Quantities whose population is looked for, in this order.
QUANTITIES = ("stiffness", "damping")
#: Trucks that have to determine a parameter of their type.
LEAST_TRUCKS = 3
#: Above this share of a campaign's variance a shared error cannot be what its interval allows for.
_DOUBTFUL_SHARE = 0.9


class StoredDraws(Sequence[CampaignDraws | None]):
    """Draws of campaigns, of the named parameters, read from disk when they are asked for."""

    def __init__(self, members: Sequence[Member], names: tuple[str, ...]):
        self._members, self._names = members, names

    def __len__(self) -> int:
        return len(self._members)

    @overload
    def __getitem__(self, index: int) -> CampaignDraws | None: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[CampaignDraws | None]: ...
    def __getitem__(self, index: int | slice) -> CampaignDraws | Sequence[CampaignDraws | None] | None:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        member = self._members[index]
        record = campaign_draws(member.output, member.draws_sha256)
        return None if record is None else record.of(tuple(n for n in self._names if n in record.names))


@dataclass(frozen=True)
class Assembled:
    """One type: its data, units of the parameters, its members, shared errors that concern it, and what to know."""

    data: TypeData
    units: tuple[str, ...]
    members: tuple[Member, ...]
    shared: tuple[SharedError, ...]
    remarks: tuple[str, ...]


@one_blas_thread()
def populations(
    of_types: Iterable[Members],
    shared: Sequence[SharedError],
    priors: HyperPriors | None = None,
    progress: Progress | None = None,
) -> tuple[list[TypePopulation], list[str]]:
    """The population of every type with enough trucks, and sentences about what was left out or is not final."""
    priors, report = priors or HyperPriors(), progress or unwatched
    populations, said = [], []
    for of_type in of_types:
        try:
            assembled = assemble(of_type, shared, priors)
            population = fit_population(
                of_type.type,
                assembled.data,
                assembled.units,
                StoredDraws(assembled.members, assembled.data.names),
                shared_names=[s.name for s in assembled.shared],
                priors=priors,
                progress=report,
            )
        except DataRejectedError as error:
            said.append(" ".join([str(error), *(f"{of_type.type}: {r}." for r in of_type.remarks[:3])]))
            continue
        said += [f"{of_type.type}: {remark}" for remark in (*of_type.remarks, *assembled.remarks)]
        populations.append(population)
    return populations, said


def assemble(of_type: Members, shared: Sequence[SharedError], priors: HyperPriors) -> Assembled:
    """Likelihoods of all campaigns of a type, for the parameters that enough of its trucks determine.

    Raises
    ------
    DataRejectedError
        If there are not enough trucks with results.
    """
    with_draws, parts = [], []
    remarks: list[str] = []
    without_draws: list[str] = []
    about: dict[str, tuple[str, str, int, str]] = {}
    laws: dict[str, set[str]] = {}
    for member in of_type.campaigns:
        record = campaign_draws(member.output, member.draws_sha256)
        if record is None:
            without_draws.append(member.campaign)
            continue
        names = tuple(n for n, q in zip(record.names, record.quantities, strict=True) if q in QUANTITIES)
        chosen = record.of(names)
        try:
            likelihood = likelihood_of(chosen)
        except (ValueError, np.linalg.LinAlgError) as error:
            remarks.append(f"campaign {member.campaign} is left out: {error}")
            continue
        for i, name in enumerate(names):
            about.setdefault(name, (chosen.quantities[i], chosen.units[i], chosen.axles[i], chosen.load_cases[i]))
            laws.setdefault(name, set()).add(chosen.laws[i])
        with_draws.append(member)
        parts.append((names, likelihood, chosen.prior_mean))
    if without_draws:
        remarks.append(f"without posterior draws, and so left out: {listing(without_draws)}")
    trucks = tuple(dict.fromkeys(m.truck for m in with_draws))
    if len(trucks) < LEAST_TRUCKS:
        raise DataRejectedError(
            f"Type '{of_type.type}' has {len(trucks)} trucks with draws; a population needs {LEAST_TRUCKS}."
        )
    order = sorted(about, key=lambda n: (QUANTITIES.index(about[n][0]), about[n][2], n))
    mixed = sorted(n for n in order if len(laws[n]) > 1)
    if mixed:
        remarks.append(
            f"campaigns of this type have different suspension laws ({', '.join(mixed[:6])}): their k and c are "
            "not comparable; give the fleet one law by --laws declared or in the campaign files"
        )
    data, concerned = _stacked(shared, order, about, with_draws, parts, trucks, remarks)
    data, left_out = _determined(data, priors)
    if left_out:
        remarks.append(f"{', '.join(left_out)}: determined in fewer than {LEAST_TRUCKS} trucks, left out")
    return Assembled(data, tuple(about[n][1] for n in data.names), tuple(with_draws), concerned, tuple(remarks))


def _stacked(
    errors: Sequence[SharedError],
    order: list[str],
    about: dict[str, tuple[str, str, int, str]],
    with_draws: list[Member],
    parts: list[tuple[tuple[str, ...], Likelihood, np.ndarray]],
    trucks: tuple[str, ...],
    remarks: list[str],
) -> tuple[TypeData, tuple[SharedError, ...]]:
    quantities = tuple(about[n][0] for n in order)
    of_error = {s.name: set(s.campaigns) for s in errors}
    shared = tuple(s for s in errors if any(m.campaign in of_error[s.name] for m in with_draws))
    place = {name: i for i, name in enumerate(order)}
    d = len(order)
    precision, shift = np.zeros((len(with_draws), d, d)), np.zeros((len(with_draws), d))
    moved = np.zeros((len(with_draws), d, len(shared)))
    means = np.full((len(with_draws), d), np.nan)
    too_narrow: dict[str, list[str]] = {}
    for c, (member, (names, likelihood, prior_mean)) in enumerate(zip(with_draws, parts, strict=True)):
        at = np.array([place[n] for n in names])
        placed = likelihood.placed(at, d)
        means[c, at] = prior_mean
        for s, error in enumerate(shared):
            if member.campaign not in of_error[error.name]:
                continue
            moved[c, at, s] = [error.moves.get(quantities[i], 0.0) for i in at]
            if error.in_intervals:
                placed, share = without_shared(placed, moved[c, :, s], error.log_sd)
                if share > _DOUBTFUL_SHARE:
                    too_narrow.setdefault(error.name, []).append(member.campaign)
        precision[c], shift[c] = placed.precision, placed.shift
    remarks += [
        f"the interval of {listing(campaigns)} is too narrow to allow for '{error}' already; set in_intervals = false, "
        "or give the error a smaller log_sd"
        for error, campaigns in too_narrow.items()
    ]
    number = {truck: t for t, truck in enumerate(trucks)}
    truck_of = np.array([number[m.truck] for m in with_draws])
    data = TypeData(
        tuple(order), quantities, trucks, tuple(m.campaign for m in with_draws), truck_of, precision, shift,
        np.nanmean(means, axis=0), moved, np.array([s.log_sd for s in shared]),
    )  # fmt: skip
    return data, shared


def _determined(data: TypeData, priors: HyperPriors) -> tuple[TypeData, list[str]]:
    """The data of the parameters that enough trucks determine, and the names of the others."""
    enough = np.isfinite(stand_alone(data, priors).value).sum(axis=0) >= LEAST_TRUCKS
    if enough.all():
        return data, []
    if not enough.any():
        raise DataRejectedError(f"No k or c is determined in {LEAST_TRUCKS} trucks of a type.")
    at = np.flatnonzero(enough)
    # What is not looked at any more is integrated out under the wide prior of the type's mean.
    rest = np.flatnonzero(~enough)
    precision, shift = [], []
    for whole, pull in zip(data.precision, data.shift, strict=True):
        inner = whole[np.ix_(rest, rest)] + np.eye(rest.size) * priors.mean_sd**-2.0
        cross = whole[np.ix_(at, rest)] @ np.linalg.inv(inner)
        precision.append(whole[np.ix_(at, at)] - cross @ whole[np.ix_(rest, at)])
        shift.append(pull[at] - cross @ (pull[rest] + data.mean[rest] * priors.mean_sd**-2.0))
    kept_names = tuple(data.names[i] for i in at)
    reduced = TypeData(
        kept_names, tuple(data.quantities[i] for i in at), data.trucks, data.campaigns, data.truck_of,
        np.array(precision), np.array(shift), data.mean[at], data.moved[:, at], data.shared_sd,
    )  # fmt: skip
    return reduced, [data.names[i] for i in rest]
