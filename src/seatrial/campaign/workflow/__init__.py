"""The steps of a campaign: run them, say where they stand, propose the next trial."""
