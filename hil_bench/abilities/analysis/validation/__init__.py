"""The plant held against closed forms, against Table I as printed and against other tools."""
