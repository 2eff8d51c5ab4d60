"""Runs the checks, one after the other, and keeps what each found."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from hil_bench.abilities.conformance import (
    error_checks,
    nmt_checks,
    pdo_checks,
    pdo_configuration_checks,
    sdo_checks,
)
from hil_bench.abilities.conformance.check import Chapter, Check, Degree, Impact
from hil_bench.abilities.conformance.device import (
    DeviceUnderTest,
    absence_after,
    fall_after,
    is_there,
)
from hil_bench.abilities.conformance.lss_checks import LSS
from hil_bench.abilities.conformance.object_dictionary_checks import OBJECTS
from hil_bench.abilities.conformance.sdo_block_checks import BLOCKS
from hil_bench.abilities.conformance.sync_checks import SYNC
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, NotRun
from hil_bench.canopen_device.nmt import NmtCommand

CHAPTERS = (
    nmt_checks.NMT,
    OBJECTS,
    sdo_checks.UPLOAD,
    sdo_checks.DOWNLOAD,
    BLOCKS,
    error_checks.ERRORS,
    pdo_checks.TPDO,
    pdo_checks.RPDO,
    pdo_configuration_checks.PARAMETERS,
    pdo_configuration_checks.MAPPING,
    SYNC,
    error_checks.EMCY,
    nmt_checks.STORAGE,
    LSS,
)
"""All checks, by subject. NMT comes first: the reset sets the values that the others restore."""


class Outcome(StrEnum):
    """The outcome of a check."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_FOLLOWED = "not followed"
    """The device deviates from what is recommended; it may."""
    NOT_RUN = "not run"
    """The check needs what the device does not keep, OPERATIONAL or to answer at all; another one
    names the cause."""
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True, slots=True)
class Result:
    """One check and what it found.

    Attributes:
        chapter: the subject.
        check: the check.
        outcome: whether the device does what is right.
        detail: what was wrong, why the check could not be done, or what else is worth telling.
    """

    chapter: str
    check: Check
    outcome: Outcome
    detail: str


def planned(allowed: Impact, chapters: Iterable[Chapter] = CHAPTERS) -> list[Check]:
    """Return the checks that `run_suite` runs, in its order."""
    checks = (check for chapter in chapters for check in chapter.checks)
    return [check for check in checks if check.impact <= allowed]


def run_suite(
    dut: DeviceUnderTest, allowed: Impact = Impact.READ, chapters: Iterable[Chapter] = CHAPTERS
) -> Iterator[Result]:
    """Run the checks.

    Args:
        dut: the device.
        allowed: the most that a check may do to it.
        chapters: the subjects, in this order.

    Yields:
        What each found, as soon as it did; `BusError` where the bus is lost.
    """
    for chapter in chapters:
        for check in chapter.checks:
            if check.impact <= allowed:
                # What the check before has caused may still be on its way.
                dut.wire.wait(dut.settling)
                dut.wire.forget()
                yield _result(dut, chapter.title, check, allowed)


def _result(dut: DeviceUnderTest, chapter: str, check: Check, allowed: Impact) -> Result:
    dut.was_started, dut.sdo.delay = False, 0.0
    if dut.absence and not is_there(dut, dut.settling):
        return Result(chapter, check, Outcome.NOT_RUN, dut.absence)
    try:
        detail = check.judge(dut)
    except NotApplicable as reason:
        result = Result(chapter, check, Outcome.NOT_APPLICABLE, str(reason))
    except NotRun as cause:
        result = Result(chapter, check, Outcome.NOT_RUN, str(cause))
    except Deviation as deviation:
        _settle(dut, allowed)
        fall = absence_after(dut, check.text)
        if dut.was_started and not fall:
            fall = fall_after(dut)
        delay = dut.sdo.delay
        late = f"an answer came {delay:.2f} s after its request: see --patience" if delay else ""
        detail = "; ".join(filter(None, (fall, str(deviation), late)))
        is_advice = check.degree is Degree.RECOMMENDED and not fall
        outcome = Outcome.NOT_FOLLOWED if is_advice else Outcome.FAILED
        result = Result(chapter, check, outcome, detail)
    else:
        return Result(chapter, check, Outcome.PASSED, detail or "")
    _settle(dut, allowed)
    return result


def _settle(dut: DeviceUnderTest, allowed: Impact) -> None:
    """Leave nothing of a check that did not come to its end."""
    if allowed >= Impact.WRITE:
        dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
    dut.sdo.abort()
