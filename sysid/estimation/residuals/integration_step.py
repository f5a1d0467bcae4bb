"""How fine runs are integrated: apart from what integrates, so that settings load without it."""

#: Largest integration step [s]; what halving it changes is checked at the optimum.
TARGET_STEP_S = 0.00125
