"""Whether records, errors and coefficients may be believed."""
