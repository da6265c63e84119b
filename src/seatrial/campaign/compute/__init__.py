"""Where a campaign's work is done: on this machine, or on many."""
