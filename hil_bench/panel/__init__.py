"""The panel: a web page that shows a running bench and breaks it, from a process of its own."""

DEFAULT_PORT = 8408
