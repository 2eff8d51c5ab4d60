"""What the data sheets of cylinder, valve, oil and pump say, in their words, as parameters."""
