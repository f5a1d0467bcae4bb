"""Finished campaigns compared: each against the first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.comparison.differences import compared
from sysid.comparison.records import Campaign, Comparison
from sysid.comparison.shared import SharedErrors, one_truck, shared_errors
from sysid.comparison.stored import StoredResult, read_result
from sysid.errors import CampaignError
from sysid.numbers import count, listing
from sysid.tabular import Tabular, distinct

if TYPE_CHECKING:
    import pandas as pd

#: Folders of one comparison: more make no page that anybody reads.
MOST_FOLDERS = 50


@dataclass(frozen=True)
class Comparisons(Tabular):
    """Every further campaign against the first, in the order in which they were given."""

    pairs: tuple[Comparison, ...]

    @property
    def changed(self) -> bool:
        """Whether anything has changed in any of them."""
        return any(pair.changed for pair in self.pairs)

    _in_row_unit = Comparison._in_row_unit

    def summary(self) -> pd.DataFrame:
        """One row per pair and quantity, SI."""
        import pandas as pd

        return pd.concat([pair.summary() for pair in self.pairs], ignore_index=True)


def compare(*folders: str | Path, cancel: bool = True, campaigns: Sequence[str | Path] = ()) -> Comparisons:
    """Differences of finished campaigns from the first, errors cancelled that they share.

    Parameters
    ----------
    folders : output folders of two or more finished calibrations.
    cancel : whether shared errors are cancelled; without, the intervals are as wide as if there were none.
    campaigns : campaign files of the folders, in their order: then the truck of each drives the runs of the other; none
        for results alone.

    Raises
    ------
    CampaignError
        If there are fewer than two folders, one is given twice, or one is no finished output folder; if there are not
        as many campaign files as folders, or one is not that of its folder.
    StoredResultsError
        If the files of a folder are damaged, changed, or of two calibrations.
    """
    paths = [Path(folder) for folder in folders]
    if not 2 <= len(paths) <= MOST_FOLDERS:
        raise CampaignError(f"compare needs two to {MOST_FOLDERS} output folders of finished calibrations.")
    if campaigns and len(campaigns) != len(paths):
        given = f"{count(len(campaigns), 'campaign file')} for {len(paths)} folders"
        raise CampaignError(f"compare has {given}; give one for every folder, in their order.")
    read = [read_result(path) for path in paths]
    seen: dict[str, Path] = {}
    for result, path in zip(read, paths, strict=True):
        other = seen.setdefault(result.identity.result_sha256, path)
        if other is not path:
            raise CampaignError(f"{path} holds the same result as {other}; give folders of two calibrations.")
    labels = _labels(read, paths)
    compared_ones = [_campaign(result, label) for result, label in zip(read, labels, strict=True)]
    pairs = zip(read[1:], compared_ones[1:], strict=True)
    found = tuple(_pair(read[0], compared_ones[0], result, one, cancel) for result, one in pairs)
    return Comparisons(_driven(found, campaigns, paths) if campaigns else found)


def _driven(
    pairs: Sequence[Comparison], campaigns: Sequence[str | Path], paths: Sequence[Path]
) -> tuple[Comparison, ...]:
    """The comparisons of one truck with the agreement of each campaign's truck with the runs of the other."""
    from sysid.comparison.agreement import finished, on_each_other

    labels = [pairs[0].first.label, *(pair.second.label for pair in pairs)]
    fits = [finished(*of_folder) for of_folder in zip(campaigns, paths, labels, strict=True)]
    found = []
    for pair, fit in zip(pairs, fits[1:], strict=True):
        agreement, said = on_each_other(fits[0], fit) if pair.one_truck else ((), ())
        found.append(replace(pair, agreement=agreement, remarks=(*pair.remarks, *said)))
    return tuple(found)


def _labels(read: Sequence[StoredResult], paths: Sequence[Path]) -> tuple[str, ...]:
    """Names of the folders; their paths where two have one name."""
    names = [result.label for result in read]
    return distinct(names if len(set(names)) == len(names) else [str(path) for path in paths])


def _campaign(result: StoredResult, label: str) -> Campaign:
    return Campaign(
        label, result.title, result.vehicle, result.test, result.identity, result.status, result.trust, result.reasons
    )


def _pair(first: StoredResult, one: Campaign, second: StoredResult, other: Campaign, cancel: bool) -> Comparison:
    same, why = one_truck(first, second)
    shared = shared_errors(first, second, same) if cancel else SharedErrors((), (), ())
    open_ended = [c.label for c, result in ((one, first), (other, second)) if not result.converged]
    if open_ended:
        # Its covariance is that of a point at which the data do not pull as hard as the priors: it says nothing.
        shared = replace(shared, undecided=f"the fit of {listing(open_ended)} did not converge")
    differences, remarks = compared(first, second, shared)
    doubts = [
        f"{c.label}: its own verdict is {(c.trust or 'none').replace('_', ' ')}"
        + (f" ({c.reasons[0].rstrip('.')})." if c.reasons else ".")
        for c in (one, other)
        if c.trust != "use"
    ]
    said = (*doubts, why, *shared.remarks, *remarks)
    return Comparison(one, other, same, tuple(differences), shared.words, said, shared.undecided)
