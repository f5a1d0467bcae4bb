"""What each allowance of the intervals does: the same trucks calibrated with one of them left out at a time."""
