"""A campaign before it is driven: simulated with known truth, calibrated, compared."""

from sysid.selftest.replicates import Check, Replicate, SelfTest, self_test

__all__ = ["Check", "Replicate", "SelfTest", "self_test"]
