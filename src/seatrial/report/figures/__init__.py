"""Figures of a report: pure functions from arrays in SI to Matplotlib figures, one family to a file.

Each figure is one column wide, so that it is as legible on a telephone as on a desk, and has no title: the page, or
whoever saves it, says what it is.
"""
