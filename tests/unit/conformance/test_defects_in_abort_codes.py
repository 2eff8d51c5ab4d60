"""Devices that abort SDO transfers with a wrong code: the suite names the clause they break."""

import struct

import pytest

from hil_bench.canopen_device import abort_codes as right

SDO_ANSWER = 0x585
GENERAL, UNSUPPORTED, NO_OBJECT = 0x08000000, 0x06010000, 0x06020000
SPECIFIER, NOT_MAPPABLE, NOT_STORED = 0x05040001, 0x06040041, 0x08000020


@pytest.mark.parametrize(
    ("wrong", "instead_of", "clause", "chapter"),
    [
        (GENERAL, right.NO_OBJECT, "7.2.4.3.17", "Object dictionary"),
        (NO_OBJECT, right.NO_SUBINDEX, "7.2.4.3.17", "Object dictionary"),
        (UNSUPPORTED, right.WRITE_ONLY, "7.2.4.3.17", "Object dictionary"),
        (UNSUPPORTED, right.READ_ONLY, "7.2.4.3.17", "Object dictionary"),
        (GENERAL, right.VALUE_TOO_HIGH, "7.2.4.3.17", "Object dictionary"),
        (GENERAL, right.NO_DATA, "7.5.2.4", "Object dictionary"),  # beyond the history's end
        (SPECIFIER, right.TOGGLE, "7.2.4.3.17", "SDO upload"),
        (GENERAL, right.COMMAND_SPECIFIER, "7.2.4.3.17", "SDO upload"),
        (GENERAL, right.TIME_OUT, "7.2.4.3.17", "SDO upload"),
        (GENERAL, right.LENGTH_TOO_HIGH, "7.2.4.3.17", "SDO download"),
        (GENERAL, right.LENGTH_TOO_LOW, "7.2.4.3.17", "SDO download"),
        (GENERAL, right.CRC, "7.2.4.3.16", "SDO block transfer"),
        (GENERAL, right.BLOCK_SIZE, "7.2.4.3.13", "SDO block transfer"),
        (GENERAL, right.SEQUENCE_NUMBER, "7.2.4.3.14", "SDO block transfer"),
        (GENERAL, right.NO_OBJECT, "7.5.2.36", "PDO mapping"),
        (NO_OBJECT, right.NOT_MAPPABLE, "7.2.4.3.17", "PDO mapping"),
        (NOT_STORED, right.DEVICE_STATE, "7.5.2.22", "SYNC and TIME"),
        (GENERAL, right.NOT_STORED, "7.5.2.13", "Store and restore"),
    ],
)
def test_a_wrong_abort_code_is_named(laboratory, wrong, instead_of, clause, chapter):
    sent, expected = (struct.pack("<I", code) for code in (wrong, instead_of[0]))

    def says(frame):
        is_it = frame.can_id == SDO_ANSWER and frame.data[:1] == b"\x80"
        if is_it and frame.data[4:] == expected:
            return [frame._replace(data=frame.data[:4] + sent)]
        return [frame]

    laboratory.says = says
    assert clause in laboratory.failed_clauses(chapter)
