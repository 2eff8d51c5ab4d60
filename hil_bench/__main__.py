"""The command ``hil-bench``, also as ``python -m hil_bench``."""

import sys

_INTERRUPTED = 130  # `ExitCode.INTERRUPTED`, which is imported only below


def main() -> int:
    """Run the command line and return its exit code; Ctrl-C counts from the first import on."""
    try:
        from hil_bench.cli import main as run  # noqa: PLC0415 - see above

        return run()
    except KeyboardInterrupt:
        return _INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
