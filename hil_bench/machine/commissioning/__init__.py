"""The controller's side of a bus that is not known yet: who is there, and is it what it should be.

Everything here talks through `hil_drivers`, so it does the same on the virtual bench and
on a machine.
"""
