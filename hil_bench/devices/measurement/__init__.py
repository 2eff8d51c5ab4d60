"""The measuring chain: from a quantity of the plant to what a sensor's electronics hand on."""
