"""Campaigns of trucks made from the literature, without any equation, prior or constant of the program."""
