"""Where the variance of every parameter comes from: noise, masses, scale readings, tires, model form, laws.

The covariance is built up from the inside: first with everything but the parameters known, then with one source after
another unknown. What a source adds to the variance of a log parameter, over its whole variance, is its share. Sources
that come later get what they add to the earlier ones, so the shares depend a little on the order of :data:`SOURCES`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.estimation.uncertainty.data_information import MASSES, SCALES, TIRES, DataInformation
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.wording import joined_words

NOISE, MODEL_FORM, LAWS = "noise", "model form", "undecided laws"
#: In the order in which they become unknown. Noise includes the priors, motions of runs, offsets and gains of sensors.
SOURCES = (NOISE, MASSES, SCALES, TIRES, MODEL_FORM, LAWS)
#: What would lower each of them.
REMEDIES = {
    NOISE: "further runs and sensors (see the advice)",
    MASSES: "better values of masses, inertias and heights in the campaign file",
    SCALES: "weighing the axles more accurately",
    TIRES: "runs at other speeds or over another bump",
    MODEL_FORM: "a model closer to the truck (the figures of measured and simulated signals show where they differ)",
    LAWS: "runs in which the suspensions move further",
}
#: Share from which on a source is named.
_NAMED = 0.25


def interval_shares(information: DataInformation) -> np.ndarray:
    """Shares (p, 6) of :data:`SOURCES` in the variance of p log parameters; every row has the sum 1."""
    prior = information.prior
    # Model error is a source of its own: the matrix already has its factor.
    data, count = information.matrix * information.factor, len(prior)
    equations = NormalEquations.of(data, prior=prior, sd=information.sd)
    kinds = np.array(information.kinds)
    variances = []
    unknown = np.zeros(kinds.size, bool)
    for source in (NOISE, MASSES, SCALES, TIRES):
        unknown |= kinds == source
        variances.append(equations.only(np.concatenate([np.ones(count, bool), unknown])).variances[:count])
    variances.append(np.diag(information.with_laws(None).covariance()))
    variances.append(np.diag(information.covariance()))
    # The sandwich may make a direction a little better known: that is a share of zero.
    grown = np.maximum.accumulate(np.array(variances), axis=0)
    return np.asarray(np.diff(grown, axis=0, prepend=0.0).T / grown[-1][:, None])


def share_sentences(names: Sequence[str], shares: np.ndarray) -> tuple[str, ...]:
    """Which sources make most of the variance of k and of c, medians over the axles, and what would lower them.

    Parameters
    ----------
    names : (p,) of the parameters; shares : (p, 6) of :func:`interval_shares`.
    """
    sentences = []
    for symbol in ("k", "c"):
        rows = [i for i, name in enumerate(names) if name.startswith(f"{symbol}_")]
        if not rows:
            continue
        typical = np.median(shares[rows], axis=0)
        named = [k for k in np.argsort(-typical) if typical[k] >= _NAMED]
        if named:
            parts = joined_words([f"{SOURCES[k]} ({100.0 * typical[k]:.0f} %)" for k in named])
            remedy = REMEDIES[SOURCES[named[0]]]
            sentences.append(f"The variance of {symbol} comes mostly from {parts}. What would lower it: {remedy}.")
    return tuple(sentences)
