"""PDO communication parameters (CiA 301, 7.5.2.35 and 7.5.2.37)."""

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.pdo import (
    COB_ID,
    INHIBIT_TIME,
    INVALID,
    RPDOS,
    TPDOS,
    TYPE,
    Pdo,
    first_pdo,
)
from hil_bench.abilities.conformance.sdo_client import code_text, download_request
from hil_bench.abilities.conformance.verdicts import NotApplicable

CHAPTER = Chapter("PDO parameters")

_RESTRICTED = (0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x7FF)
"""Some of the restricted identifiers (7.3.5)."""


@CHAPTER.check("7.5.2.35", "the identifier of a valid PDO cannot be changed", Impact.WRITE)
def identifier_of_valid(dut: DeviceUnderTest) -> str:
    """Write another identifier while the PDO exists: any abort is right."""
    codes = set()
    for pdo in _each_kind(dut, TYPE):
        with pdo.configured({}):
            other = pdo.cob_id & ~INVALID ^ 0x400
            codes.add(expect_abort_and_keep(dut, pdo.index, COB_ID, other))
    return codes_text(codes)


@CHAPTER.check("7.3.5", "restricted identifiers abort", Impact.WRITE)
def restricted(dut: DeviceUnderTest) -> str:
    """Give a PDO the identifiers of NMT, SDO, error control and so on."""
    codes = set()
    for pdo in _each_kind(dut, TYPE):
        with pdo.disabled():
            for can_id in _RESTRICTED:
                cob_id = pdo.cob_id & ~INVALID & ~0x7FF | can_id
                codes.add(expect_abort_and_keep(dut, pdo.index, COB_ID, cob_id))
    return codes_text(codes)


@CHAPTER.check("7.5.2.37", "the inhibit time of a valid TPDO cannot be changed", Impact.WRITE)
def inhibit_time_of_valid(dut: DeviceUnderTest) -> str:
    """Write it while the PDO exists: any abort is right."""
    pdo = first_pdo(dut, TPDOS, INHIBIT_TIME)
    with pdo.configured({}):
        before = dut.number(pdo.index, INHIBIT_TIME)
        return code_text(expect_abort_and_keep(dut, pdo.index, INHIBIT_TIME, before + 1))


def _each_kind(dut: DeviceUnderTest, *subindices: int) -> list[Pdo]:
    """Return the first RPDO and the first TPDO that can be changed.

    Raises:
        NotApplicable: there is neither.
    """
    pdos, why = [], ""
    for among in (RPDOS, TPDOS):
        try:
            pdos.append(first_pdo(dut, among, *subindices))
        except NotApplicable as reason:
            why = str(reason)
    if not pdos:
        raise NotApplicable(why)
    return pdos


def expect_abort_and_keep(dut: DeviceUnderTest, index: int, subindex: int, value: int) -> int:
    """Write what must be refused, and restore it where it was not; return the abort code."""
    before = dut.number(index, subindex)
    size = dut.variable(index, subindex).data_type.size
    try:
        return dut.sdo.expect_abort(
            download_request(index, subindex, value.to_bytes(size, "little"))
        )
    finally:
        if dut.number(index, subindex) != before:
            dut.write(index, subindex, before)


def codes_text(codes: set[int]) -> str:
    """Return abort codes in a line."""
    return ", ".join(map(code_text, sorted(codes)))
