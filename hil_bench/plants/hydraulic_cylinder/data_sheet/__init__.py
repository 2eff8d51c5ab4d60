"""Parameters from the data sheets of cylinder, valve, oil and pump, in the sheets' terms."""
