"""The virtual field devices: object dictionary on one side, plant quantities on the other."""
