"""The benchmark: public records with fixed splits, methods that predict them, scores, and one table of all."""
