"""Coefficients by least squares of accelerations or their weak form, without a simulation."""
