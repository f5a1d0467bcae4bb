"""Command line of the toolkit."""
