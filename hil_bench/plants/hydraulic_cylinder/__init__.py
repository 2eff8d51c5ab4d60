"""The valve-controlled hydraulic cylinder, by the models of `model`, as a plant."""
