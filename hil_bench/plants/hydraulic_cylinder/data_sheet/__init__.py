"""The data sheets of cylinder, valve, oil and pump, in their words, as parameters."""
