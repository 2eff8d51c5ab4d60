"""The bus at bit level: exact lengths of frames, arbitration and errors (ISO 11898-1)."""
