"""The answer while the vehicle runs: a stream of samples, a filter on every one, and advice."""
