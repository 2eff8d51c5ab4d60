"""Traffic of real CANopen and J1939 stacks, and the program that puts faults in."""
