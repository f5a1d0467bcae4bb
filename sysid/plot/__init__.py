"""Figures of results: each function takes a result and optional axes, returns the axes and computes nothing heavy."""

from sysid.estimates.suspension_values import AxleEstimates, Estimate, suspension_estimates
from sysid.plot.bridges import amplification_against_speed, effect_history, influence_line
from sysid.plot.changes import changes
from sysid.plot.comparison import SOURCE_LABELS, SOURCES, comparison
from sysid.plot.drops import drop, drops
from sysid.plot.fleet import MOST_ROWS as FLEET_ROWS
from sysid.plot.fleet import population_loads, shrinkage, truck_map
from sysid.plot.histories import (
    autocorrelation,
    channel_grid,
    channel_title,
    overlay,
    residual_spectrum,
    suspension_histories,
)
from sysid.plot.knowledge import likelihood_profile, next_runs, prior_against_posterior
from sysid.plot.loops import suspension_loop, suspension_loop_pair
from sysid.plot.mode_figures import mode_shape, mode_shapes
from sysid.plot.posterior import (
    corner,
    correlation,
    marginal,
    marginals,
    posterior_correlation,
    trace,
    traces,
)
from sysid.plot.predictions import (
    axle_load_against_speed,
    load_ratio,
    load_ratio_against_speed,
    load_ratios,
    suspension_force,
)
from sysid.plot.road import effective_profile, profile, scan
from sysid.plot.roads import (
    axle_load_along_road,
    damage_against_speed,
    load_spectrum,
    range_pairs,
    road_load_against_speed,
)
from sysid.plot.style import axle_color, figure, figure_of, label, shared_legend
from sysid.plot.svg import svg_element, svg_file
from sysid.plot.truck import truck, truck_height

__all__ = [
    "FLEET_ROWS",
    "SOURCES",
    "SOURCE_LABELS",
    "AxleEstimates",
    "Estimate",
    "amplification_against_speed",
    "autocorrelation",
    "axle_color",
    "axle_load_against_speed",
    "axle_load_along_road",
    "changes",
    "channel_grid",
    "channel_title",
    "comparison",
    "corner",
    "correlation",
    "damage_against_speed",
    "drop",
    "drops",
    "effect_history",
    "effective_profile",
    "figure",
    "figure_of",
    "influence_line",
    "label",
    "likelihood_profile",
    "load_ratio",
    "load_ratio_against_speed",
    "load_ratios",
    "load_spectrum",
    "marginal",
    "marginals",
    "mode_shape",
    "mode_shapes",
    "next_runs",
    "overlay",
    "population_loads",
    "posterior_correlation",
    "prior_against_posterior",
    "profile",
    "range_pairs",
    "residual_spectrum",
    "road_load_against_speed",
    "scan",
    "shared_legend",
    "shrinkage",
    "suspension_estimates",
    "suspension_force",
    "suspension_histories",
    "suspension_loop",
    "suspension_loop_pair",
    "svg_element",
    "svg_file",
    "trace",
    "traces",
    "truck",
    "truck_height",
    "truck_map",
]
