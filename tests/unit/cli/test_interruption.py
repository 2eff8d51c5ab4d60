"""Ctrl-C and SIGTERM as a wish."""

import os
import signal

import pytest

from hil_bench.cli.interruption import interruption


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_a_wish(number):
    with interruption() as wish:
        assert not wish.requested
        os.kill(os.getpid(), number)
        assert wish.requested


def test_a_second_signal_does_not_wait():
    with interruption():
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_the_handlers_of_before_come_back():
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with interruption():
        pass
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
