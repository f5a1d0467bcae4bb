"""Pictures of the main figures against baselines; `python tests/plot/test_images.py` draws the baselines anew.

The tolerance lets another version of matplotlib shift a label by a pixel; it does not let a curve or a legend change,
which the last test shows.
"""

import sys
from pathlib import Path

import pytest
from matplotlib.testing.compare import compare_images

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from small_results import decaying_drop, small_campaign, small_history, small_results

from sysid import plot
from sysid.road import effective_profiles

BASELINES = Path(__file__).parent / "baseline"
TOLERANCE = 6.0
DPI = 45


def figures():
    results = small_results()
    fit, posterior, one = results.fit, results.posterior, results.predictions.passes[0]
    rows = plot.suspension_estimates("stiffness", results.drops, fit, posterior)
    campaign = small_campaign()
    bump = results.scans["bump"].profile
    case = next(iter(campaign.load_cases.values()))
    roads = effective_profiles(campaign.vehicle, case, case, bump)
    history = fit.histories[0]
    return {
        "drop": lambda: plot.drop(decaying_drop()),
        "profile": lambda: plot.profile(results.scans["bump"]),
        "effective_profile": lambda: plot.effective_profile(bump, roads),
        "overlay": lambda: plot.overlay(small_history(), history.columns[2]),
        "overlay_with_bands": lambda: plot.overlay(history, history.columns[0]),
        "comparison": lambda: plot.comparison(rows, "stiffness"),
        "marginal": lambda: plot.marginal(posterior, "k_1", fit),
        "correlation": lambda: plot.correlation(plot.posterior_correlation(posterior), posterior.names),
        "next_runs": lambda: plot.next_runs(results.advice),
        "load_ratio": lambda: plot.load_ratio(one, 0),
        "load_ratio_against_speed": lambda: plot.load_ratio_against_speed(results.predictions.sweeps[0]),
        "axle_load_against_speed": lambda: plot.axle_load_against_speed(
            results.predictions.sweeps[0], [39240.0, 29430.0]
        ),
        "truck": lambda: plot.truck(
            campaign.vehicle, [("k [kN/m]", ["1 ± 2", "3 empty\n4 laden"]), ("at", ["a", "b"])], (0, 1)
        ),
    }


def write(ax, path):
    plot.figure_of(ax).savefig(path, dpi=DPI, metadata={"Software": None})
    return str(path)


@pytest.fixture(scope="module")
def drawn():
    return figures()


@pytest.mark.parametrize("name", sorted(p.stem for p in BASELINES.glob("*.png")))
def test_figure_looks_as_before(drawn, tmp_path, name):
    made = write(drawn[name](), tmp_path / f"{name}.png")
    baseline = tmp_path / f"{name}-expected.png"
    baseline.write_bytes((BASELINES / f"{name}.png").read_bytes())
    assert compare_images(str(baseline), made, TOLERANCE) is None


def test_every_figure_has_a_baseline(drawn):
    assert {p.stem for p in BASELINES.glob("*.png")} == set(drawn)


def test_a_drop_without_its_envelope_is_seen(tmp_path):
    baseline = tmp_path / "drop.png"
    baseline.write_bytes((BASELINES / "drop.png").read_bytes())
    made = write(plot.drop(decaying_drop(usable=False)), tmp_path / "unusable.png")
    assert compare_images(str(baseline), made, TOLERANCE) is not None


if __name__ == "__main__":
    BASELINES.mkdir(exist_ok=True)
    for name, draw in figures().items():
        write(draw(), BASELINES / f"{name}.png")
