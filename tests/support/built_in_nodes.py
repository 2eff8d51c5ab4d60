"""The nodes of the built-in bench as a file has them, for tests that add something to it."""

NODES = """
[nodes]
valve = { profile = "valve_408", node_id = 1 }
pressure_a = { profile = "pressure_404", node_id = 2, source = "P_A" }
pressure_b = { profile = "pressure_404", node_id = 3, source = "P_B" }
position = { profile = "encoder_406", node_id = 4 }
"""
