"""Priors and likelihoods as one density: its mode, its draws, and what they predict."""
