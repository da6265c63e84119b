"""A campaign's results on disk."""
