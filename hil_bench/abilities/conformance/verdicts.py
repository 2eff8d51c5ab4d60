"""Exceptions by which a check ends without passing."""

from hil_bench.errors import HilBenchError


class Deviation(HilBenchError):  # noqa: N818 - a verdict, not an error
    """The device did not do what the clause asks for; the message says what, and what is right."""


class Silence(Deviation):
    """The device did not answer."""


class NotApplicable(HilBenchError):  # noqa: N818 - a verdict, not an error
    """The check cannot be done with this device or on this bus; the message says why."""


class NotRun(HilBenchError):  # noqa: N818 - a verdict, not an error
    """The check needs a state that the device does not keep; the message names the cause."""


class Refused(Deviation):
    """The device aborted an SDO transfer that it should have served.

    Attributes:
        code: the abort code.
    """

    def __init__(self, text: str, code: int) -> None:
        super().__init__(text)
        self.code = code
