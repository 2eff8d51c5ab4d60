"""Tables of TOML: documents, keys, the values they may hold, where each came from, what is wrong.

The mechanism alone; which tables and keys there are is told by those whose tables they are.
"""
