"""Figures and page of the paper's study; every figure is a pure function from a study's saved results."""
