"""Nouns everyone shares: coefficient names, units at the boundary, Gaussians, records, errors, whole files."""
