"""A bus for commands that listen until Ctrl-C."""

import signal


class ScriptedBus:
    """A python-can bus that hears messages, then gets Ctrl-C."""

    def __init__(self, messages):
        self._messages = iter(messages)

    def recv(self, _timeout):
        message = next(self._messages, None)
        if message is None:
            signal.raise_signal(signal.SIGINT)
        return message

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass
