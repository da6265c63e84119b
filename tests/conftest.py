"""Settings of every test: hypothesis draws the same examples each time and keeps nothing on disk."""

from hypothesis import settings

settings.register_profile("reproducible", derandomize=True, deadline=None, database=None)
settings.load_profile("reproducible")
