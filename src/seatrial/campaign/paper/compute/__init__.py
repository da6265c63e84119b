"""Parts of the study: what is computed and kept."""
