"""The command line of this ability: a verb a module."""
