"""Engines of the time integration behind one protocol: C++ compiled for this machine, and its reference in JAX."""
