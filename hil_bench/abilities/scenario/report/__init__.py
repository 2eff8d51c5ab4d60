"""The report of scenarios and judged recordings: one HTML file, and the same for a program."""
