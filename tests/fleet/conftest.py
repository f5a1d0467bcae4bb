"""Results of one small fleet for all tests that only read them."""

from __future__ import annotations

from pathlib import Path

import pytest
from fleet_results import write_fleet_results

from sysid.fleet import population
from sysid.fleet.results import FleetResults, compute
from sysid.posterior.options import SamplingOptions

SHORT = SamplingOptions(
    ensembles=4, segment_steps=100, adapting_steps=0, min_steps=200, max_steps=1500, min_effective=200.0
)


def sample_little(patch: pytest.MonkeyPatch) -> None:
    """Let populations be sampled by short chains."""
    patch.setattr(population, "_WEIGHTED", 100)
    patch.setattr(population, "_WEIGHTED_PAIRS", 0)
    patch.setattr(
        population.fit_population, "__kwdefaults__", {**population.fit_population.__kwdefaults__, "sampling": SHORT}
    )


@pytest.fixture
def quick_sampling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Populations of a test are sampled by short chains."""
    sample_little(monkeypatch)


@pytest.fixture(scope="session")
def fleet_folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folder with the fleet file, and folder of the results."""
    return write_fleet_results(tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="session")
def fleet_results(fleet_folders: tuple[Path, Path]) -> FleetResults:
    """Populations and loads of the small fleet."""
    patch = pytest.MonkeyPatch()
    sample_little(patch)
    try:
        return compute(*fleet_folders)
    finally:
        patch.undo()
