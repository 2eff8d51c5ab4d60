"""A bench that runs: in real time or in virtual time, and programs beside it."""
