"""The Modbus server: frames, requests, connections, and the process that they live in."""
