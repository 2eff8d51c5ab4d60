"""Writes the first part of a stopped child's extended registers, and checks all of them after it.

It prints by which error that failed, or by which error a second set fails that no kernel accepts.

A program of its own, since it is the libraries preloaded into it that are under test.
"""

import ctypes
import errno
import os
import signal
import struct
import sys

NT_X86_XSTATE = 0x202  # elf.h
PTRACE_TRACEME, PTRACE_GETREGSET, PTRACE_SETREGSET = 0, 0x4204, 0x4205  # linux/ptrace.h
MXCSR = slice(24, 28)  # these places: Intel SDM volume 1, 13.4, layout of the XSAVE area
XMM0 = slice(160, 176)
FEATURES = 464  # what of the area may be in use, by the bits of XCR0; Linux writes it here
XSTATE_BV = slice(512, 520)  # what of the area is in use
SSE, AVX = 1 << 1, 1 << 2
END_OF_HEADER = 576
YMM_HIGH = slice(576, 832)

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.ptrace.restype = ctypes.c_long


class IoVec(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def ptrace(request, pid=0, address=0, data=0):
    """Return 0, or the error number."""
    arguments = ctypes.c_long(pid), ctypes.c_void_p(address), ctypes.c_void_p(data)
    return ctypes.get_errno() if LIBC.ptrace(request, *arguments) < 0 else 0


def transfer(request, pid, data):
    """Return the error number and the bytes that were read or written."""
    buffer = ctypes.create_string_buffer(bytes(data), len(data))
    vector = IoVec(ctypes.addressof(buffer), len(data))
    error = ptrace(request, pid, NT_X86_XSTATE, ctypes.addressof(vector))
    return error, bytearray(buffer.raw[: vector.length])


def main():
    child = os.fork()
    if not child:
        if error := ptrace(PTRACE_TRACEME):
            os._exit(error)
        signal.raise_signal(signal.SIGSTOP)
    _, status = os.waitpid(child, 0)
    if not os.WIFSTOPPED(status):
        return f"no tracing here: {os.strerror(os.waitstatus_to_exitcode(status))}"
    try:
        return trace(child)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def trace(child):
    error, whole = transfer(PTRACE_GETREGSET, child, bytes(65536))
    if error:
        return f"no extended registers here: {os.strerror(error)}"
    if not struct.unpack_from("<Q", whole, FEATURES)[0] & AVX:
        return "no registers beyond those of SSE here"
    size = len(whole)
    whole[XSTATE_BV] = struct.pack("<Q", struct.unpack("<Q", whole[XSTATE_BV])[0] | SSE | AVX)
    whole[YMM_HIGH] = bytes(range(256))
    assert transfer(PTRACE_SETREGSET, child, whole) == (0, whole)

    part = whole[:END_OF_HEADER]
    part[XMM0] = b"is written anew!"
    error, written = transfer(PTRACE_SETREGSET, child, part)
    _, after = transfer(PTRACE_GETREGSET, child, bytes(65536))
    assert len(after) == size
    if error:
        print(errno.errorcode[error])
        return None
    assert (len(written), after[XMM0]) == (END_OF_HEADER, part[XMM0])
    whole[XMM0] = after[XMM0]
    assert after == whole, "a register beyond the part has changed"

    part[MXCSR] = b"\xff" * 4  # no kernel takes its reserved bits
    print(errno.errorcode[transfer(PTRACE_SETREGSET, child, part)[0]])
    return None


if __name__ == "__main__":
    sys.exit(main())
