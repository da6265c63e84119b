"""Each item of the paper judged against what it prints."""
