import signal

import pytest
from support.signals import SIGNALS


@pytest.fixture
def signals_that_are_heard():
    """Undo what a shell without job control does to what it starts in the background.

    It ignores SIGINT and SIGQUIT, as nohup does SIGHUP, and the bench leaves that in force.
    """
    before = {number: signal.signal(number, signal.SIG_DFL) for number in SIGNALS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
