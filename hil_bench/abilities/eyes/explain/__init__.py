"""Diagnosis of a bus log: causes first, each with its frames and its clause."""
