"""Fixtures of the campaign tests."""

from __future__ import annotations

from small_campaign import shipped_folder, small, small_text

__all__ = ["shipped_folder", "small", "small_text"]
