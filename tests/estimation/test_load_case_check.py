"""Load cases exchanged in the list of runs are refused, right lists and mixed evidence are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.campaign.records import Acquisition, BumpRun, Campaign, Log
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import DataRejectedError
from sysid.estimation.fit import load_case_check
from sysid.estimation.fit.load_case_check import check_load_cases

LISTED = ("empty", "empty", "laden", "laden")


def campaign(listed=LISTED) -> Campaign:
    cases = {name: LoadCase(name, (), (), (), ()) for name in dict.fromkeys(listed)}
    runs = tuple(BumpRun("", case, 4.0, i, Log(f"run{i}.csv", 0.005, ())) for i, case in enumerate(listed))
    return Campaign("", "", Path(), Path("campaign.toml"), Vehicle("", (), ()), cases, Acquisition(0.005, None), (),
                    runs, {}, (), {})  # fmt: skip


def check(monkeypatch, under: dict[str, list[float]], listed=LISTED, left=None) -> None:
    """Check with given misfits of the runs under each load case, and of the list as it stands.

    `left` are those after a fit of the exchanged list and of the list as it stands: by default as before it.
    """
    given = campaign(listed)
    own = np.array([under[case][i] for i, case in enumerate(listed)])
    monkeypatch.setattr(load_case_check, "misfits", lambda model, *rest: own if model is None else np.array(model))

    def fitted(of: Campaign) -> np.ndarray:
        as_listed = [r.load_case for r in of.bump_runs] == list(listed)
        if left is not None:
            return np.array(left[as_listed])
        return np.array([under[r.load_case][i] for i, r in enumerate(of.bump_runs)])

    check_load_cases(given, None, None, None, None, lambda other: under[other.bump_runs[0].load_case], fitted)


def test_exchanged_load_cases_are_named(monkeypatch):
    with pytest.raises(DataRejectedError, match="'empty' as 'laden', those listed as 'laden' as 'empty'"):
        check(monkeypatch, {"empty": [10.0, 12.0, 7.0, 8.0], "laden": [7.0, 9.0, 10.0, 11.0]})


def test_start_values_that_suit_the_wrong_list_accuse_nobody(monkeypatch):
    before = {"empty": [10.0, 12.0, 7.0, 8.0], "laden": [7.0, 9.0, 10.0, 11.0]}
    exchanged, listed = [3.0, 3.0, 4.0, 4.0], [1.0, 1.1, 1.0, 1.1]
    check(monkeypatch, before, left=(exchanged, listed))
    # One load case that says so is not enough.
    check(monkeypatch, before, left=([1.0, 1.0, 1.1, 1.1], [3.0, 3.0, 1.1, 1.1]))
    with pytest.raises(DataRejectedError, match="exchanged"):
        check(monkeypatch, before, left=(listed, exchanged))


@pytest.mark.parametrize(
    "under",
    [
        {"empty": [5.0, 5.0, 9.0, 9.0], "laden": [9.0, 9.0, 5.0, 5.0]},
        # The drops are empty: start values of the laden truck may be so poor that its runs seem empty.
        {"empty": [5.0, 5.0, 4.0, 4.0], "laden": [20.0, 20.0, 6.0, 6.0]},
        # One run contradicts, or nothing is clear.
        {"empty": [10.0, 7.0, 7.0, 7.0], "laden": [7.0, 10.0, 10.0, 10.0]},
        {"empty": [10.0, 10.0, 9.6, 9.6], "laden": [9.6, 9.6, 10.0, 10.0]},
    ],
)
def test_right_lists_and_mixed_evidence_pass(monkeypatch, under):
    check(monkeypatch, under)


def test_one_load_case_cannot_be_exchanged(monkeypatch):
    check(monkeypatch, {"empty": [10.0, 1.0]}, ("empty", "empty"))


def test_two_of_three_load_cases_are_exchanged(monkeypatch):
    listed = ("empty", "half", "laden")
    under = {"empty": [9.0, 2.0, 30.0], "half": [2.0, 9.0, 20.0], "laden": [40.0, 30.0, 2.0]}
    with pytest.raises(DataRejectedError, match="'empty' as 'half', those listed as 'half' as 'empty'"):
        check(monkeypatch, under, listed)
