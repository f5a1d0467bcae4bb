"""Pairs of campaigns of one truck: what `compare` finds of a damper that has changed."""
