"""Items of the study: what was found beside what the paper prints, with a verdict each."""
