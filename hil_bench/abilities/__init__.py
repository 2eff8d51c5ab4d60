"""What the bench can do beside running, a folder an ability; see `hil_bench.ability`."""
