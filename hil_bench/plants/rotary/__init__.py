"""The valve-controlled hydraulic motor: an inertia that turns, on the valve of the cylinder."""
