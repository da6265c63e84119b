"""Priors of scalar parameters, and the smooth map from the real line to their support.

Samplers work on the unconstrained z, of mean 0 and standard deviation 1 under the prior, or nearly; `log_density(z)` is the
prior's density of z, the log-Jacobian included. Priors are pytrees of their numbers: code compiled for one serves all of its
kind.
"""

from seatrial.estimation.priors.box import CORNER, LogUniform, Uniform
from seatrial.estimation.priors.density import DensityPrior
from seatrial.estimation.priors.normal import LogNormal, Normal
from seatrial.estimation.priors.prior import Prior, by_kind, nominal, physical_support, prior_curve, restricted
from seatrial.estimation.priors.truncated import TruncatedNormal, half_normal, truncated_normal

__all__ = [
    "CORNER",
    "DensityPrior",
    "LogNormal",
    "LogUniform",
    "Normal",
    "Prior",
    "TruncatedNormal",
    "Uniform",
    "by_kind",
    "half_normal",
    "nominal",
    "physical_support",
    "prior_curve",
    "restricted",
    "truncated_normal",
]
