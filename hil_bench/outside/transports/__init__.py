"""The ways frames reach the bench: the only sockets of the project."""
