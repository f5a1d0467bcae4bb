"""Limits above which a number of the fit causes a warning; warnings, reports and the choice of laws share them."""

from __future__ import annotations

#: Residual over noise (of the instruments, or of the channels before the bump where that is more) from which on the
#: model's form, not the noise, limits the fit: in fits of simulated trucks estimates were biased from about there.
MISFIT = 1.3
#: Share of the sum of squares that a law or a part is expected to explain, from which on it is searched for also where
#: residuals are below :data:`MISFIT`.  What acts on one axle shows in few channels, and the median hides it.  On linear
#: trucks, errors of the contact model alone had expected gains of up to 0.0005 of the sum of squares, one truck with a
#: progressive air spring 0.06.
LEAST_SHARE = 0.01
#: Relative RMS change of a channel when the integration step is halved: values of k and c move by about as much, and
#: this is a tenth of the narrowest intervals that a campaign yields.
STEP_HALVING = 2e-3
#: Distance [sd] between the optimum and that of an independent solver.
SOLVERS_APART_SD = 0.5
#: Gain in the information criterion from which on a richer law is chosen (R. E. Kass and A. E. Raftery, Bayes factors,
#: JASA 90 (1995), doi:10.1080/01621459.1995.10476572).
DECISIVE = 10.0
