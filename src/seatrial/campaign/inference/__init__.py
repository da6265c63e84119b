"""What the records say of the parameters of one structure."""
