"""Parts that several abilities have in common and the core does without; no ability itself."""
