"""Which structure the records support."""
