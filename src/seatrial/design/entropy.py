"""Information of a trial: how far the entropy of the coefficients falls, in nats.

Eqs. (6) to (14) of "Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle" with the
signs made right: gain = H(before) - H(after) = 0.5 ln(|P_before| / |P_after|) >= 0, over the block of the coefficients only; the
vehicle's own state is not what the trial is run for.
"""

from jaxtyping import Array, Float

from seatrial.numerics.gaussian import Gaussian


def entropy_reduction(before: Gaussian, after: Gaussian, n_dynamic: int) -> Float[Array, "*batch"]:
    """Entropy reduction of the coefficient block, nats.

    Args:
        before: joint belief before the trial, dynamic states first.
        after: joint belief after it.
        n_dynamic: number of dynamic states, which are marginalised out.
    """
    return before.marginal(n_dynamic).entropy() - after.marginal(n_dynamic).entropy()
