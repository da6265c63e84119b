"""Attacks on seatrial, a module for each subject; `release/attack.py` runs them."""
