"""The files that a campaign names: found, bounded, hashed, and read to one log per run or drop."""
