"""Peak load ratios of a finished calibration by the normal at its optimum instead of the sampled posterior.

    python -m studies.independent.normal_peaks CAMPAIGN OUTPUT

prints 5, 50 and 95 % quantiles of every axle in every requested pass, as JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from sysid.estimation.fit.state import restored
from sysid.prediction.predict_passes import DRAWS, predict
from sysid.workflow import stages
from sysid.workflow.calibration import Calibration
from sysid.workflow.settings import Settings


def normal_peaks(
    campaign: Path, output: Path, settings: Settings | None = None, *, seed: int = 0
) -> list[list[list[float]]]:
    """Quantiles by pass and axle, of as many draws and by the same simulation as the command `predict`.

    Parameters
    ----------
    campaign, output : a campaign, and the folder where `calibrate.py run` of it ended.
    settings : of that run, None for its default options.
    """
    done = Calibration(campaign, output, settings, resume=True)
    kept = done.result(stages.FIT)
    profiles = {name: scan.profile for name, scan in done.scan().items()}
    state = restored(done.campaign, profiles, kept.point)
    point = state.point
    draws = np.random.default_rng(seed).multivariate_normal(point.mode, point.covariance, DRAWS, method="eigh")
    passes = predict(state, draws, done.campaign.predictions, seed=seed, sweep_km_h=()).passes
    return [np.transpose([p.peak_ratio_q05, p.peak_ratio_q50, p.peak_ratio_q95]).tolist() for p in passes]


def main(arguments: list[str] | None = None) -> None:
    """Print the quantiles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", type=Path, help="campaign file or its folder")
    parser.add_argument("output", type=Path, help="folder where `calibrate.py run` wrote its results")
    options = parser.parse_args(arguments)
    sys.stdout.write(json.dumps(normal_peaks(options.campaign, options.output)) + "\n")


if __name__ == "__main__":
    main()
