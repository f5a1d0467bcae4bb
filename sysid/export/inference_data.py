"""`posterior.nc`: the draws in the InferenceData layout of ArviZ, readable by any netCDF-4 program."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import CampaignError
from sysid.export.result_json import result_identity
from sysid.files import write_bytes
from sysid.results.contents import Results

if TYPE_CHECKING:
    import xarray as xr


def posterior_tree(results: Results) -> xr.DataTree:
    """The draws as a tree with the groups ``posterior`` and ``sample_stats``, dimensions ``chain`` and ``draw``.

    A chain is one independent ensemble; its draws are walker after walker over the first half of the kept steps, then
    over the second.  Every parameter is a variable of its own, in its natural unit (attribute ``units``), with the
    ``effective_draws`` and ``rhat`` of result.json; ``/`` in a name, which HDF5 reserves, becomes ``|``.
    ``sample_stats.lp`` is the log-probability up to a constant.  Attributes ``verdict`` and ``verdict_reasons`` say
    whether the draws may be used, as result.json does.

    Raises CampaignError if the posterior has not been sampled.
    """
    # These load xarray and emcee; stages that export no draws need not wait for them.
    import xarray as xr

    from sysid.posterior.inference_data import posterior_dataset, sample_stats

    posterior = results.posterior
    if posterior is None:
        raise CampaignError("posterior.nc needs posterior draws and there are none; run the stage 'sample' first.")
    estimates = () if results.fit is None else (*results.fit.parameters, *results.fit.run_parameters)
    about = {p.name: {"units": p.unit, "quantity": p.quantity} for p in estimates}
    attrs: dict[str, Any] = {
        "inference_library": "emcee",
        "inference_library_version": str(results.provenance.get("versions", {}).get("emcee", "unknown")),
        "creation_library": "sysid",
        "sample_dims": ["chain", "draw"],
        "status": results.status,
        "likelihood": posterior.likelihood,
        "seed": int(posterior.seed),
        "steps": int(posterior.draws.shape[1]),
        "walkers": int(posterior.draws.shape[2]),
        "burn_in_steps": int(posterior.burn_in),
        "thinning_steps": int(posterior.thin),
        "draw_order": "first half of the steps walker after walker, then the second half",
    }
    identity = result_identity(results)
    attrs |= {"run": identity.run, "date": identity.date, "result_sha256": identity.result_sha256}
    if results.judgement is not None:
        attrs |= {"verdict": results.judgement.trust, "verdict_reasons": list(results.judgement.reasons)}
    groups = {"posterior": posterior_dataset(posterior, about), "sample_stats": sample_stats(posterior)}
    return xr.DataTree.from_dict({name: group.assign_attrs(attrs) for name, group in groups.items()})


def write_posterior(results: Results, path: Path) -> None:
    """Write `posterior.nc` to `path`, complete or not at all.

    Raises CampaignError if the posterior has not been sampled.
    """
    tree = posterior_tree(results)
    # The library writes to a path only, and follows links there.
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "posterior.nc"
        tree.to_netcdf(file, engine="h5netcdf")
        write_bytes(path, file.read_bytes())
