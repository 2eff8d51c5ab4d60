"""The command ``hil-bench``, also as ``python -m hil_bench``."""

import signal
import sys

_INTERRUPTED = 130  # `ExitCode.INTERRUPTED`, which is imported only below


def main() -> int:
    """Run the command line and return its exit code; Ctrl-C counts from the first import on."""
    try:
        from hil_bench.cli import main as run  # noqa: PLC0415 - see above

        return run()
    except KeyboardInterrupt:
        return _INTERRUPTED
    finally:  # nothing is left to be interrupted but Python's own end, which would say so at length
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    sys.exit(main())
