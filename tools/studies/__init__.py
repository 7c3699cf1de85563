"""Studies of how often verdicts and estimates are right; they run for hours and write tables."""
