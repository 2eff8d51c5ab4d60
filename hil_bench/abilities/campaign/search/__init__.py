"""The search for values of parameters for which a requirement fails."""
