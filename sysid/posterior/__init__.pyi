from .log_density import LIKELIHOOD as LIKELIHOOD
from .log_density import LogDensity as LogDensity
from .moves import LaplaceMove as LaplaceMove
from .moves import posterior_moves as posterior_moves
from .options import SamplingOptions as SamplingOptions
from .sampled_posterior import Posterior as Posterior
from .sampled_posterior import PosteriorSummary as PosteriorSummary
from .sampling import sample_posterior as sample_posterior
