"""All subsets of the terms of a linear regression: closed-form evidence, inclusion probabilities and averages."""
