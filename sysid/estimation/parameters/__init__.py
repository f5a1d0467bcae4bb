"""Parameters of a calibration, their priors, and where each enters the laws of the vehicle."""
