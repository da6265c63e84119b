"""Priors that suit many vehicles, as messages name them and forms offer them."""

SIZES = (0.0001, 0.1)  # Ends of a prior of a size, SI
USUAL_SHARE = 0.6  # Standard deviation of a coefficient about its published value, of that value
TIMES = (0.05, 10.0)  # Ends of a prior of a time constant, s
# Ends of a prior of the correlation time of a slow error, s: up to three times a run of 100 s, or it is cut off there.
DRIFT_TIMES = (0.05, 300.0)
# Each as keys of a campaign file, in a sentence.
SIZE_PRIOR, TIME_PRIOR = (
    f'distribution = "log-uniform", lower = {lower} and upper = {upper}' for lower, upper in (SIZES, TIMES)
)
