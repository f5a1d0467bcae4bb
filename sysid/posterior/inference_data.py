"""The draws in the layout of ArviZ: groups ``posterior`` and ``sample_stats``, dimensions ``chain`` and ``draw``."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sysid.tabular import distinct

if TYPE_CHECKING:
    import xarray as xr


class Summary(Protocol):
    """Summary of a parameter's draws: its name, effective draws and R-hat."""

    @property
    def name(self) -> str:
        """Name of the parameter."""

    @property
    def ess(self) -> float:
        """Effective number of draws."""

    @property
    def rhat(self) -> float:
        """R-hat over the ensembles."""


class Draws(Protocol):
    """Draws of all ensembles after burn-in, in natural units."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    @property
    def draws(self) -> np.ndarray:
        """Draws (ensembles, steps, walkers, parameters)."""

    @property
    def log_probability(self) -> np.ndarray:
        """Log-probability up to a constant (ensembles, steps, walkers)."""

    @property
    def summaries(self) -> Sequence[Summary]:
        """Summary of every parameter."""


@contextmanager
def without_arviz_notice() -> Iterator[None]:
    """Let ArviZ be imported without the notice about its next version that it gives each user once a day."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"\s*ArviZ is undergoing a major refactor", FutureWarning)
        yield


def draw_order(steps: int, walkers: int) -> np.ndarray:
    """Which draw of an ensemble, step * walkers + walker, stands where in a chain (steps * walkers,).

    The first half of a chain holds the first half of the steps, walker after walker, the second half the rest.  So
    neighbouring draws are successive steps of a walker, whose correlation an effective sample size has to see, and
    split R-hat compares early with late steps.
    """
    place = np.arange(steps * walkers)
    late = place >= place.size // 2
    return np.lexsort((place // walkers, place % walkers, late))


def variable_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Variable names for parameter `names`: distinct, not empty, without the ``/`` that HDF5 takes for a group."""
    return distinct(name.replace("/", "|").replace("\0", " ").strip().strip(".") or "parameter" for name in names)


def posterior_dataset(posterior: Draws, about: Mapping[str, Mapping[str, Any]] | None = None) -> xr.Dataset:
    """One variable per parameter, (chain, draw) in its natural unit; a chain is one independent ensemble.

    Parameters
    ----------
    about : more attributes of the variables by parameter name.
    """
    # xarray takes half a second to import; stages that export no draws need not wait for it.
    import xarray as xr

    flat = _ordered(posterior.draws)
    summaries = {s.name: s for s in posterior.summaries}
    variables = {}
    for index, (variable, name) in enumerate(zip(variable_names(posterior.names), posterior.names, strict=True)):
        attrs: dict[str, Any] = {"parameter": name, **(about or {}).get(name, {})}
        if name in summaries:
            attrs |= {"effective_draws": summaries[name].ess, "rhat": summaries[name].rhat}
        variables[variable] = xr.Variable(("chain", "draw"), np.ascontiguousarray(flat[:, :, index]), attrs)
    return xr.Dataset(variables, _coordinates(posterior), {"sample_dims": ["chain", "draw"]})


def sample_stats(posterior: Draws) -> xr.Dataset:
    """Variable ``lp``, (chain, draw): log-probability up to a constant."""
    import xarray as xr

    lp = _ordered(posterior.log_probability)
    return xr.Dataset({"lp": xr.Variable(("chain", "draw"), lp)}, _coordinates(posterior))


def arviz_data(posterior: Draws) -> Any:
    """The data type of the installed ArviZ; without ArviZ the tree that its versions from 1 on use."""
    import xarray as xr

    groups = {"posterior": posterior_dataset(posterior), "sample_stats": sample_stats(posterior)}
    try:
        with without_arviz_notice():
            import arviz
    except ImportError:
        return xr.DataTree.from_dict(groups)
    # From version 1 on the name means xarray's tree.
    container: Any = getattr(arviz, "InferenceData", xr.DataTree)
    return xr.DataTree.from_dict(groups) if container is xr.DataTree else container(**groups)


def _ordered(values: np.ndarray) -> np.ndarray:
    ensembles, steps, walkers = values.shape[:3]
    flat = values.reshape(ensembles, steps * walkers, *values.shape[3:])
    return np.asarray(flat[:, draw_order(steps, walkers)])


def _coordinates(posterior: Draws) -> dict[str, np.ndarray]:
    ensembles, steps, walkers = posterior.log_probability.shape
    return {"chain": np.arange(ensembles), "draw": np.arange(steps * walkers)}
