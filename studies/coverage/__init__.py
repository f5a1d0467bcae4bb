"""Coverage of intervals and calibration of ranks over many simulated data sets."""
