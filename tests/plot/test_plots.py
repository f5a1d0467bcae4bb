"""Figures show the numbers they are given and leave matplotlib as it was."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy import stats
from small_results import (
    DECREMENT,
    PERIOD,
    Z90,
    Words,
    before_sampling,
    decaying_drop,
    small_fit,
    small_history,
    small_profile,
    small_results,
)

from sysid import plot
from sysid.plot.posterior import _prior_density
from sysid.plot.style import label, thin
from sysid.road import AxleRoad


@pytest.fixture(scope="module")
def results():
    return small_results()


def draws_of(results):
    """One call of every public figure, with axes of our own where it takes them."""
    fit, posterior, one = results.fit, results.posterior, results.predictions.passes[0]
    history = fit.histories[0]
    rows = plot.suspension_estimates("stiffness", results.drops, fit, posterior)
    scan = results.scans["bump"]
    return {
        "drop": lambda ax=None: plot.drop(results.drops.files[0], ax),
        "scan": lambda ax=None: plot.scan(scan, ax),
        "profile": lambda ax=None: plot.profile(scan, ax),
        "overlay": lambda ax=None: plot.overlay(history, history.columns[0], ax),
        "autocorrelation": lambda ax=None: plot.autocorrelation(fit, ax),
        "residual_spectrum": lambda ax=None: plot.residual_spectrum(fit, ax),
        "marginal": lambda ax=None: plot.marginal(posterior, "k_1", fit, ax),
        "trace": lambda ax=None: plot.trace(posterior, "k_1", fit, ax),
        "correlation": lambda ax=None: plot.correlation(plot.posterior_correlation(posterior), posterior.names, ax),
        "load_ratio": lambda ax=None: plot.load_ratio(one, 1, ax),
        "comparison": lambda ax=None: plot.comparison(rows, "stiffness", ax),
        "priors": lambda ax=None: plot.prior_against_posterior(fit, posterior, ax),
        "next_runs": lambda ax=None: plot.next_runs(results.advice, ax),
        "likelihood_profile": lambda ax=None: plot.likelihood_profile(small_profile(), ax),
    }


FIGURES = (
    "drop", "scan", "profile", "overlay", "autocorrelation", "marginal", "trace", "correlation", "load_ratio",
    "comparison", "priors", "likelihood_profile", "next_runs", "residual_spectrum",
)  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_figures_use_the_axes_they_get_and_touch_nothing_global(results, name):
    before = dict(mpl.rcParams)
    draw = draws_of(results)[name]
    ax = Figure().add_subplot()
    assert draw(ax) is ax
    own = draw()
    assert own is not ax
    assert own.has_data()
    assert any(a.get_xlabel() for a in own.figure.axes) or name == "correlation"
    assert dict(mpl.rcParams) == before


def test_priors_and_results_are_drawn_over_the_prior_median(results):
    lines = plot.prior_against_posterior(results.fit).lines
    prior, known = lines[0].get_xdata(), lines[1].get_xdata()
    assert prior == pytest.approx(np.exp(np.array([-1.0, 1.0]) * Z90 * 0.4))
    # k_1: its prior median is 1.2 times its value, known to 1 %.
    assert known == pytest.approx(np.exp(np.array([-1.0, 1.0]) * Z90 * 0.01) / 1.2)


def test_next_runs_show_worst_and_median_of_every_row(results):
    advice = results.advice
    ax = plot.next_runs(replace(advice, masses=(replace(advice.now, exact="mass of " + "x" * 200),)))
    shown = {line.get_label(): line.get_xdata() for line in ax.lines if not line.get_label().startswith("_")}
    # Now, one run that halves all standard deviations, one sensor that quarters them, one mass that changes nothing;
    # kt_1, of 5 %, is no k or c: c_2 is known worst, to 5 %, the median of k and c is 2 %.
    np.testing.assert_allclose(shown["worst of k and c"], [5.0, 2.5, 1.25, 5.0])
    np.testing.assert_allclose(shown["median of k and c"], [2.0, 1.0, 0.5, 2.0])
    ticks = [t.get_text() for t in ax.get_yticklabels()]
    assert ticks[:3] == ["known now", "20 km/h, laden", "20 km/h, laden, with LVDT at axle 2"]
    assert len(ticks[3]) <= 81
    assert max(len(line) for line in ticks[3].splitlines()) <= 50
    assert [t.get_text() for t in ax.texts] == ["c_2"] * 4
    assert ax.yaxis_inverted()


def test_a_parabolic_profile_lies_on_that_of_the_covariance():
    parabola, profile, _ = plot.likelihood_profile(small_profile()).lines[:3]
    expected = np.interp(profile.get_xdata(), parabola.get_xdata(), parabola.get_ydata())
    assert profile.get_ydata() == pytest.approx(expected, abs=0.01)


def test_history_shows_measured_simulated_and_their_difference(results):
    history = results.fit.histories[0]
    grid = plot.suspension_histories(history, (0, 1))
    upper, lower = grid[0, 0], grid[1, 0]
    measured, simulated = (line.get_ydata() for line in upper.get_lines()[:2])
    np.testing.assert_allclose(measured, history.measured[0] * 1e3)
    np.testing.assert_allclose(simulated, history.simulated[0] * 1e3)
    np.testing.assert_allclose(lower.get_lines()[0].get_ydata(), np.cos(40.0 * history.time_s), atol=1e-9)
    assert "[mm]" in upper.get_ylabel()
    assert "m/s²" in grid[0, 1].get_ylabel()
    assert any("no acceleration recorded" in text.get_text() for text in grid[2, 1].texts)


def test_clipped_samples_are_marked_and_left_out_of_the_residual(results):
    history = results.fit.histories[0]
    fig = plot.figure()
    upper, lower = fig.subplots(2)
    plot.overlay(history, history.columns[2], upper, lower)
    (marks,) = (line for line in upper.get_lines() if line.get_label() == "clipped")
    np.testing.assert_allclose(marks.get_xdata(), history.time_s[50:53])
    assert np.isnan(lower.get_lines()[0].get_ydata()[50:53]).all()


def test_the_darker_band_is_the_posterior_and_the_lighter_one_a_new_reading(results):
    history = results.fit.histories[0]
    fig = plot.figure()
    upper, lower = fig.subplots(2)
    plot.overlay(history, history.columns[0], upper, lower)
    half = np.exp(-history.time_s)
    expected = {"90 % posterior": half, "90 % new readings": np.hypot(half, Z90)}
    shown = {c.get_label(): c for c in lower.collections}
    assert set(shown) == set(expected)
    for name, height in expected.items():
        corners = shown[name].get_paths()[0].vertices
        assert corners[:, 1].max() == pytest.approx(height.max())
        assert corners[:, 1].min() == pytest.approx(-height.max())
        late = corners[np.isclose(corners[:, 0], history.time_s[-1])]
        assert late[:, 1].max() == pytest.approx(height[-1])
    assert shown["90 % posterior"].get_alpha() > 2.0 * shown["90 % new readings"].get_alpha()
    legend = [text.get_text() for text in lower.get_legend().get_texts()]
    assert sorted(legend) == sorted(expected)
    # About the simulated curve in the panel above.
    assert len(upper.collections) == 2
    alone = plot.overlay(small_history(), history.columns[0]).figure.axes[1]
    assert not alone.collections
    assert len(alone.patches) == 1


def test_unknown_column_is_named(results):
    with pytest.raises(KeyError, match="sensor0_mm"):
        plot.overlay(results.fit.histories[0], "nothing")


def test_an_axle_has_one_colour_everywhere(results):
    color = plot.axle_color(1)
    one = results.predictions.passes[0]
    history = results.fit.histories[0]
    lines = [
        plot.load_ratio(one, 1).get_lines()[0],
        plot.overlay(history, history.columns[1]).get_lines()[1],
        plot.drop(decaying_drop(axle=1)).get_lines()[1],
    ]
    assert {to_hex(line.get_color()) for line in lines} == {color}
    assert len({plot.axle_color(i) for i in range(8)}) == 8


def test_envelope_passes_through_the_peaks_of_an_exact_decay():
    analysis = decaying_drop()
    ax = plot.drop(analysis)
    upper = next(line for line in ax.get_lines() if line.get_label() == "envelope")
    time, value = upper.get_xdata(), upper.get_ydata()
    expected = 2.0 + 30.0 * np.exp(-DECREMENT / PERIOD * (time - 1.0))
    np.testing.assert_allclose(value, expected, rtol=1e-9)
    by_label = {line.get_label(): line for line in ax.get_lines()}
    assert len(by_label["peak used"].get_xdata()) == 4
    assert len(by_label["peak not used"].get_xdata()) == 1


def test_unusable_drop_says_so():
    ax = plot.drop(decaying_drop(usable=False))
    assert "not usable" in [text.get_text() for text in ax.texts]
    assert "envelope" not in [line.get_label() for line in ax.get_lines()]


def test_outliers_of_the_scanner_do_not_squeeze_the_bump(results):
    scan = results.scans["bump"]
    wild = replace(
        scan,
        strip_height_m=np.append(scan.strip_height_m[1:], 5.0),
        cloud_height_m=np.append(scan.cloud_height_m[1:], -5.0),
    )
    low, high = plot.profile(wild).get_ylim()
    assert -30.0 < low < 0.0
    assert 80.0 < high < 110.0
    assert plot.scan(wild).collections[0].get_clim() == pytest.approx((low, high))


def test_effective_profiles_start_at_the_bump_and_keep_the_colour_of_the_axle(results):
    profile = results.scans["bump"].profile
    roads = (AxleRoad(1, np.array([-0.5, 0.0, 0.5]), np.array([0.0, 0.02, 0.0])),)
    ax = plot.effective_profile(profile, roads)
    (line,) = ax.get_lines()
    np.testing.assert_allclose(line.get_xydata(), [[-0.5, 0.0], [0.0, 20.0], [0.5, 0.0]])
    assert to_hex(line.get_color()) == plot.axle_color(1)
    corners = ax.collections[0].get_paths()[0].vertices
    # The half-sine squared of height 80 mm, its start moved to zero.
    assert corners[:, 1].max() == pytest.approx(80.0, rel=1e-3)
    assert corners[np.argmax(corners[:, 1]), 0] == pytest.approx(1.5 - profile.start_m, abs=0.011)


def test_a_figure_as_a_file_is_a_drawing_of_its_own(results):
    root = ET.fromstring(plot.svg_file(plot.load_ratio(results.predictions.passes[0], 0).figure))
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    texts = {e.text for e in root.iter("{http://www.w3.org/2000/svg}text")}
    assert "dynamic / static load [-]" in texts


def test_load_ratio_is_force_over_static_load(results):
    p = results.predictions.passes[0]
    ax = plot.load_ratio(p, 0)
    assert ax.get_lines()[0].get_ydata().max() == pytest.approx(1.8, rel=1e-6)
    assert [c.get_label() for c in ax.collections] == ["90 % band"]
    early = plot.load_ratio(before_sampling().predictions.passes[0], 0)
    assert not early.collections
    assert early.get_lines()[0].get_label() == "least squares"


def test_instants_beyond_the_driven_runs_are_hatched(results):
    p = results.predictions.passes[0]
    (hatched,) = [c for c in plot.load_ratio(p, 1).collections if c.get_label() == "beyond the driven runs"]
    assert hatched.get_hatch() == "////"
    (path,) = hatched.get_paths()
    assert (path.vertices[:, 0].min(), path.vertices[:, 0].max()) == pytest.approx((0.151, 0.25), abs=1e-9)
    force = plot.suspension_force(p, 1)
    assert any(c.get_label() == "beyond the driven runs" for c in force.collections)
    twice = np.abs(np.abs(p.time_s - 0.5) - 0.2) < 0.05
    two = plot.load_ratio(replace(p, beyond=np.array([twice, twice])), 0)
    (hatched,) = [c for c in two.collections if c.get_label() == "beyond the driven runs"]
    assert len(hatched.get_paths()) == 2


def test_speeds_beyond_the_driven_runs_have_open_marks(results):
    sweep = replace(results.predictions.sweeps[0], beyond=np.array([[False, False], [False, True], [True, True]]))
    ax = plot.load_ratio_against_speed(sweep)
    open_marks = [line for line in ax.lines if line.get_markerfacecolor() == "white" and len(line.get_xdata())]
    assert [line.get_xdata().round(6).tolist() for line in open_marks] == [[60.0], [25.0, 60.0]]
    assert "beyond the driven runs" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_axle_loads_against_speed_are_ratios_times_static_loads_and_driven_speeds_are_shaded(results):
    sweep, static = results.predictions.sweeps[0], np.array([40e3, 30e3])
    ax = plot.axle_load_against_speed(sweep, static)
    curves = [line for line in ax.lines if line.get_label().startswith("axle ")]
    for axle, curve in enumerate(curves):
        np.testing.assert_allclose(curve.get_ydata(), sweep.peak_ratio.q50[:, axle] * static[axle] / 1e3)
    (shaded,) = [p for p in ax.patches if p.get_label() == "driven"]
    assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == pytest.approx([3.6 * v for v in sweep.driven_m_s])
    # As the star of a load: faster than any run is beyond, whatever the axle reaches.
    faster = 3.6 * sweep.speed_m_s[sweep.speed_m_s > 1.2 * sweep.driven_m_s[1]]
    open_marks = [line for line in ax.lines if line.get_markerfacecolor() == "white" and len(line.get_xdata())]
    assert faster.size > 0
    assert len(open_marks) == len(static)
    assert all(np.isin(faster, line.get_xdata()).all() for line in open_marks)


def test_the_truck_stands_to_scale_and_a_row_has_one_text_per_axle(results):
    vehicle = results.campaign.vehicle
    ax = plot.truck(vehicle, [("k", ["1", "2"])])
    wheels = [p for p in ax.patches if isinstance(p, Circle) and p.get_radius() > 0.2 * ax.patches[-1].get_radius()]
    tires = [p for p in wheels if p.get_edgecolor()[3] > 0.0]
    per_metre = tires[0].get_radius() / vehicle.axles[0].tire_radius_m
    distance = tires[1].get_center()[0] - tires[0].get_center()[0]
    assert distance / per_metre == pytest.approx(vehicle.axles[1].x_m - vehicle.axles[0].x_m)
    with pytest.raises(ValueError, match="one text for each of 2 axles"):
        plot.truck(vehicle, [("k", ["1"])])


def test_estimates_are_matched_to_axles_and_load_cases(results):
    rows = plot.suspension_estimates("stiffness", results.drops, results.fit, results.posterior)
    assert [(r.axle, r.load_case, r.drop_load_case) for r in rows] == [
        (0, None, "empty"), (1, "empty", "empty"), (1, "laden", None),
    ]  # fmt: skip
    first = rows[0].estimates
    assert set(first) == {"paper", "corrected", "fitted", "posterior"}
    # Lognormal intervals of drops and fit, quantiles of the posterior.
    of_drops = stats.lognorm(4e3 / 3e5, scale=3e5).interval(0.9)
    assert (first["paper"].low, first["paper"].high) == pytest.approx(of_drops)
    assert (first["fitted"].low, first["fitted"].high) == pytest.approx(stats.lognorm(0.01, scale=4.2e5).interval(0.9))
    s = results.posterior.summaries[0]
    assert (first["posterior"].value, first["posterior"].low, first["posterior"].high) == (s.q50, s.q05, s.q95)
    assert rows[0].best is first["posterior"]
    assert not rows[1].estimates["paper"].usable
    assert set(rows[2].estimates) == {"fitted", "posterior"}
    assert stats.norm.ppf(0.95) == pytest.approx(Z90)


def test_estimates_fall_back_on_what_there_is(results):
    rows = plot.suspension_estimates("damping", results.drops, None, None)
    assert [(r.axle, r.load_case) for r in rows] == [(0, "empty"), (1, "empty")]
    assert rows[0].best.source == "corrected"
    assert rows[1].best is None
    assert plot.suspension_estimates("damping", None, None, None) == ()
    fitted = plot.suspension_estimates("damping", None, results.fit, None)
    assert [r.best.source for r in fitted] == ["fitted", "fitted"]


def test_correlation_agrees_with_numpy_and_is_unknown_where_nothing_varies(results):
    flat = results.posterior.draws.reshape(-1, 6)
    centred = flat - flat.mean(axis=0)
    expected = centred.T @ centred / np.outer(*2 * [np.linalg.norm(centred, axis=0)])
    np.testing.assert_allclose(plot.posterior_correlation(results.posterior), expected, atol=1e-12)
    still = results.posterior.draws.copy()
    still[..., 0] = 1.0
    found = plot.posterior_correlation(replace(results.posterior, draws=still))
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found[1:, 1:], expected[1:, 1:], atol=1e-12)


def test_prior_is_the_lognormal_of_scipy():
    p = small_fit().parameters[0]
    x = np.array([3e5, 5e5, 8e5])
    np.testing.assert_allclose(_prior_density(p, x), stats.lognorm(p.prior_sd, scale=p.prior_median).pdf(x), rtol=1e-12)


def test_thinning_keeps_every_peak():
    x = np.arange(10000.0)
    y = np.zeros(10000)
    y[[17, 4242, 9998]] = 5.0, -7.0, 3.0
    z = np.full(10000, np.nan)
    thin_x, thin_y, thin_z = thin(x, y, z, most=500)
    assert len(thin_x) <= 510
    assert set(thin_y) == {0.0, 5.0, -7.0, 3.0}
    assert (thin_x[0], thin_x[-1]) == (0.0, 9999.0)
    assert np.isnan(thin_z).all()
    assert thin(x, z, most=100)[0].size <= 110


def test_user_text_becomes_one_printable_line():
    assert label("a\nb\x00c") == "a b c"
    assert label("\U0001f69a$x^$") == "▯$x^$"
    assert label("x" * 300) == "x" * 47 + "…"


def test_hostile_names_reach_the_figure_as_plain_text():
    hostile = small_results(Words.all("$\\frac{1}$\U0001f69a<b>"))
    history = hostile.fit.histories[0]
    svg = plot.svg_element(plot.channel_grid(history)[0, 0].figure, "h", "x")
    assert "$\\frac{1}$▯&lt;b&gt;" in svg


def test_suspension_force_and_ratio_against_speed_show_their_numbers():
    predictions = small_results().predictions
    one, sweep = predictions.passes[0], predictions.sweeps[0]
    ax = plot.suspension_force(one, 1)
    assert max(line.get_ydata().max() for line in ax.lines[:1]) == pytest.approx(
        one.suspension_force_N.q50[1].max() / 1e3, rel=1e-3
    )
    ax = plot.load_ratio_against_speed(sweep)
    np.testing.assert_allclose(ax.lines[1].get_ydata(), sweep.peak_ratio.q50[:, 1])
    np.testing.assert_allclose(ax.lines[1].get_xdata(), [10.0, 25.0, 60.0])
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["not driven", "axle 1", "axle 2"]
    with pytest.raises(ValueError, match="no suspension forces"):
        plot.suspension_force(before_sampling().predictions.passes[0], 0)


def test_pairs_have_axes_only_where_something_is_drawn(results):
    names = results.posterior.names[:3]
    grid = plot.corner(results.posterior, names, results.fit)
    places = np.tril_indices(len(names))
    assert plot.figure_of(grid[0, 0]).axes == list(grid[places])
    assert all(grid[r, c].has_data() for r, c in zip(*places, strict=True))
    assert all(ax is None for ax in grid[np.triu_indices(len(names), 1)])


def test_the_legend_of_a_history_hides_no_peak():
    """The largest values late in the record, where the legend stands, lie below its box."""
    late = small_history()
    row = np.zeros_like(late.time_s)
    row[int(0.8 * row.size)] = 1.0
    late = replace(late, measured=np.tile(row, (len(late.columns), 1)))
    ax = plot.overlay(late, late.columns[0])
    ax.figure.draw_without_rendering()
    box = ax.get_legend().get_window_extent()
    (line,) = [line for line in ax.lines if line.get_label() == "measured"]
    x, y = ax.transData.transform(line.get_xydata()).T
    under = (x > box.x0) & (x < box.x1)
    assert y[under].max() == y.max()
    assert y.max() < box.y0
