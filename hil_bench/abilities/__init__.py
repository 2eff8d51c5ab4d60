"""The bench's abilities beside running, a folder each; see `hil_bench.ability`."""
