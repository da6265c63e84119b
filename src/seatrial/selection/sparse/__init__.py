"""Sparse regression without a posterior over structures, for comparison: thresholded least squares and the horseshoe."""
