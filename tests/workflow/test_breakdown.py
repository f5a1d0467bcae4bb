"""Linear algebra that breaks down inside a stage is one sentence and exit code 3, and costs that stage alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.errors import NumericsError
from sysid.estimation.residuals.compressed import square_factor
from sysid.workflow import Calibration

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


def test_a_singular_matrix_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*given: object) -> None:
        np.linalg.inv(np.zeros((2, 2)))

    calibration = Calibration(DATA, tmp_path / "out")
    # It looks at the scan too.
    calibration.check()
    monkeypatch.setattr("sysid.road.scan.analyse_scan", breaks)
    with pytest.raises(NumericsError, match=r"stage 'scan' could not solve its equations \(Singular matrix\)") as error:
        calibration.scan()
    assert error.value.exit_code == 3
    assert "\n" not in str(error.value)
    # What was finished before is kept.
    assert {p.stem for p in (tmp_path / "out" / "stages").glob("*.npz")} == {"check"}


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_residuals_that_are_not_finite_give_a_factor_that_is_not(bad: float) -> None:
    """A trial of a search is rejected for it; the eigenvalues of such a matrix would not converge."""
    block = np.random.default_rng(0).normal(size=(50, 4))
    block[7, 2] = bad
    with np.errstate(all="ignore"):
        assert np.isnan(square_factor(block.T @ block)).all()
