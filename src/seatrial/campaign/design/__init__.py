"""Which trial to run: sweeps, searches and free forms over what the campaign allows."""
