"""The command line of this ability."""
