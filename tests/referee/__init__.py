"""A second evaluator of requirements, and cases for it."""
