"""The abilities of the bench beside running, a folder each; see `hil_bench.ability`."""
