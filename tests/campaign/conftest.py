"""Fixtures of the campaign tests."""

from __future__ import annotations

from small_campaign import linear_truck_folder, small, small_text

__all__ = ["linear_truck_folder", "small", "small_text"]
