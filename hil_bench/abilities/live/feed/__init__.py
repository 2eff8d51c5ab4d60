"""The feed of a running bench: a local socket for those who watch it and give it commands."""
