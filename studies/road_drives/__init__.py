"""Trucks on ordinary roads by equations of their own, and what the force balance finds of them."""
