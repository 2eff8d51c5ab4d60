"""The table ``[j1939]``: its devices, their signals, and those of DBC files."""
