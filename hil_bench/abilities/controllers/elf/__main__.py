"""The process that simulates a chip: unicorn stays out of the bench's own.

It is started with the descriptor of its link to the bench, ends with it, and hears no signal of a
terminal.
"""

import signal
import socket
import sys

from hil_bench.abilities.controllers.elf.simulation import simulate

if __name__ == "__main__":
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody asks how copies end
    with socket.socket(fileno=int(sys.argv[1])) as parent:
        try:
            simulate(parent)
        except ConnectionError:  # the bench is gone
            sys.exit(0)
