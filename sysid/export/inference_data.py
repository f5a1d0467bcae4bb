"""`posterior.nc`: the draws in the InferenceData layout of ArviZ, readable by any netCDF-4 program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import CampaignError
from sysid.export.contents import Results
from sysid.export.files import write_atomically
from sysid.export.naming import distinct

if TYPE_CHECKING:
    import xarray as xr


def posterior_tree(results: Results) -> xr.DataTree:
    """The draws as a tree with the groups ``posterior`` and ``sample_stats``, dimensions ``chain`` and ``draw``.

    A chain is one independent ensemble; its draws are the walkers of the first kept step, then those of the next, and
    so on.  Every parameter is a variable of its own, in its natural unit (attribute ``units``); ``/`` in a name, which
    HDF5 reserves, becomes ``|``.  ``sample_stats.lp`` is the log-probability up to a constant.

    Raises CampaignError if the posterior has not been sampled.
    """
    # xarray takes half a second to import; stages that export no draws need not wait for it.
    import xarray as xr

    posterior = results.posterior
    if posterior is None:
        raise CampaignError("posterior.nc needs posterior draws and there are none; run the stage 'sample' first.")
    ensembles, steps, walkers, _ = posterior.draws.shape
    dims = ("chain", "draw")
    coords = {"chain": np.arange(ensembles), "draw": np.arange(steps * walkers)}
    estimates = (
        {} if results.fit is None else {p.name: p for p in (*results.fit.parameters, *results.fit.run_parameters)}
    )
    flat = posterior.draws.reshape(ensembles, steps * walkers, -1)
    variables = {}
    for index, (variable, name) in enumerate(zip(variable_names(posterior.names), posterior.names, strict=True)):
        about = {"parameter": name}
        if name in estimates:
            about |= {"units": estimates[name].unit, "quantity": estimates[name].quantity}
        variables[variable] = xr.Variable(dims, np.ascontiguousarray(flat[:, :, index]), about)
    stats = {"lp": xr.Variable(dims, posterior.log_probability.reshape(ensembles, steps * walkers))}
    attrs: dict[str, Any] = {
        "inference_library": "emcee",
        "inference_library_version": str(results.provenance.get("versions", {}).get("emcee", "unknown")),
        "creation_library": "sysid",
        "sample_dims": ["chain", "draw"],
        "status": results.status,
        "likelihood": posterior.likelihood,
        "seed": int(posterior.seed),
        "steps": steps,
        "walkers": walkers,
        "burn_in_steps": int(posterior.burn_in),
        "thinning_steps": int(posterior.thin),
        "draw_order": "walkers of one kept step, then the next step",
    }
    return xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(variables, coords, attrs),
            "sample_stats": xr.Dataset(stats, coords, attrs),
        }
    )


def variable_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Variable names for parameter `names`: distinct, not empty, without the ``/`` that HDF5 takes for a group."""
    return distinct(name.replace("/", "|").replace("\0", " ").strip().strip(".") or "parameter" for name in names)


def write_posterior(results: Results, path: Path) -> None:
    """Write `posterior.nc` to `path`, complete or not at all.

    Raises CampaignError if the posterior has not been sampled.
    """
    tree = posterior_tree(results)
    write_atomically(path, lambda temporary: tree.to_netcdf(temporary, engine="h5netcdf"))
