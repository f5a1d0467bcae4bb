"""Fixtures of the tests of log formats."""

from small_campaign import small

__all__ = ["small"]
