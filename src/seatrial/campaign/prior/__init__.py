"""What the priors mean before any data."""
