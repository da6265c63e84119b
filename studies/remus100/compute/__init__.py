"""What is computed for the items of the paper."""
