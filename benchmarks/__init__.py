"""Speed of `sysid` beside other solvers and beside its own kernel without Python: ``python -m benchmarks --help``."""
