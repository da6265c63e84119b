"""Figures, tables and the self-contained page that a campaign ends with."""
