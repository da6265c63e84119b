"""How a vehicle moves under a record's controls, and what its sensors show of it."""
