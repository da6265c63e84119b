"""Trials out: the schedule of a campaign in the formats that operators and vehicles read, its limits repeated in each."""
