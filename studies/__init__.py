"""Studies of the calibration's statistics; not part of the installed package."""
