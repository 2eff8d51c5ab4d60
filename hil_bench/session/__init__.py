"""A bench that runs: in real time, in lock-step, in virtual time, or beside a firmware program."""
