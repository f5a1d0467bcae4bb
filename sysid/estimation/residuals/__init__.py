"""From parameters to residuals of all bump runs, and their derivatives."""
