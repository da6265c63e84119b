"""All English about findings: a catalogue with one entry for each code, and its rendering."""
