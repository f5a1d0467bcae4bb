"""Simulated fleets: whether intervals hold the truth, what shrinkage brings, and whether broken dampers are found."""
