"""The evidence pack: what this machine shows of the tool, to be checked offline by anybody."""
