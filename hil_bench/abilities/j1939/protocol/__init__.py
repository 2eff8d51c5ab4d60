"""An electronic control unit (ECU) of SAE J1939 and ISO 11783, sans I/O."""
