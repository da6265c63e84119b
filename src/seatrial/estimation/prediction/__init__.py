"""How well records that were not fitted are predicted, beside simple baselines."""
