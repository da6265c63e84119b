"""Figures of the study, each a pure function of the study's saved results."""
