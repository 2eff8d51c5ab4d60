"""The valve-controlled hydraulic cylinder, by the models of `hil_bench.plant`, as a plant."""
