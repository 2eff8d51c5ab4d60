"""Numbers on the command line."""

import argparse
import math


def count(text: str) -> int:
    """Return a positive integer.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 1 up")
    return int(text)


def count_from_zero(text: str) -> int:
    """Return an integer that is not negative.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 0 up")
    return int(text)


def positive(text: str) -> float:
    """Return a positive number.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a positive number")
    return number
