"""Identification: the plant's parameters, and what is known of them, from a recording."""
