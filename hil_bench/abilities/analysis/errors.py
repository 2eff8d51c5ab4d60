"""Errors that an analysis raises."""

from hil_bench.errors import ParameterError


class OperatingPointError(ParameterError):
    """There is no such operating point; the message says what stands against it."""


class NyquistError(ParameterError):
    """An excitation holds frequencies that its sampling cannot carry."""
