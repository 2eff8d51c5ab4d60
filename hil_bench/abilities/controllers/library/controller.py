"""An instance of a shared library: one call a tick, frames packed in buffers.

A compiled wheel packs and calls in machine code (``_call.c``), any other by ctypes.
"""

import atexit
import ctypes
import faulthandler
import os
import sys
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path
from struct import Struct
from typing import Any, Final

from hil_bench.abilities.controllers.seam import ControllerEnd, TimedFrame, make_timed
from hil_bench.canopen_device.frame import Frame, make_frame
from hil_bench.errors import ControllerError, ControllerFileError

Advance = Callable[
    [int, int, int, Sequence[TimedFrame], bytearray, type[TimedFrame], type[Frame]],
    tuple[int, int, list[TimedFrame] | None],
]
"""Given the addresses of ``hil_controller_advance`` and of an instance, a time [ns], frames that
came, room for those that are sent and what they become, returns an `hil_state`, how many were sent,
and these; None where they are still to be read, or where one is wrong."""

try:
    from hil_bench.abilities.controllers.library import _call  # type: ignore[attr-defined]
except ImportError:
    _advance: Advance | None = None
else:
    _advance = _call.advance

VERSION: Final = 1
SHOWN_LINES: Final = 20
"""Lines of its output that messages show."""

_ROOM: Final = 256  # frames of a call
_FRAME: Final = Struct("=qIBBBx8s")  # struct hil_frame
_SIZE_OF_FRAME: Final = _FRAME.size
_pack, _iter_unpack = _FRAME.pack_into, _FRAME.iter_unpack
_EXTENDED, _REMOTE = 1, 2
_SIZE = ctypes.c_size_t
_POINTER = ctypes.c_void_p


class State(IntEnum):
    """The answers of ``hil_controller_advance``."""

    FAILED = -1
    RUNNING = 0
    STARTING = 1
    ENDED = 2


_FUNCTIONS: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "version": (ctypes.c_uint32, ()),
    "create": (_POINTER, (ctypes.POINTER(ctypes.c_char_p),)),
    "advance": (
        ctypes.c_int,
        (_POINTER, ctypes.c_int64, _POINTER, _SIZE, _POINTER, _SIZE, ctypes.POINTER(_SIZE)),
    ),
    "message": (ctypes.c_char_p, (_POINTER,)),
    "reset": (None, (_POINTER,)),
    "destroy": (None, (_POINTER,)),
}


@cache
def _guard() -> None:
    """Let no library end this process in silence: a run that it cuts off is not passed.

    A crash says where it was (`faulthandler`). `exit` says so, and ends with exit code 1 as every
    controller does that fails: the C library calls what is registered with it, and
    `__cxa_finalize` takes that away again, before Python is gone.
    """
    if not faulthandler.is_enabled():
        faulthandler.enable(2)  # standard error, whoever captures `sys.stderr`
    if sys.platform != "linux" or not hasattr(libc := ctypes.CDLL(None), "gnu_get_libc_version"):
        return  # elsewhere nothing takes the function away again
    handle = ctypes.create_string_buffer(1)
    is_over = False

    def leave(_: object) -> None:
        if not is_over:
            os.write(2, b"hil-bench: error: a controller's library has called exit()\n")
            os._exit(1)

    def let_go() -> None:
        nonlocal is_over
        is_over = True
        libc["__cxa_finalize"](ctypes.byref(handle))

    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(leave)
    libc["__cxa_atexit"](function, None, ctypes.byref(handle))
    atexit.register(let_go)
    _KEPT.extend((function, handle))


_KEPT: list[object] = []


@cache
def load_library(path: Path, _changed: int) -> dict[str, Any]:
    """Return the functions of a library by their short names.

    Args:
        path: of the library.
        _changed: when its file was last changed: another file is another library.

    Raises:
        ControllerError: it lacks a function or is of another version.
        ControllerFileError: it cannot be loaded.
    """
    _guard()
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise ControllerFileError(f"{path}: cannot be loaded: {error}") from None
    functions = {}
    for name, (result, arguments) in _FUNCTIONS.items():
        try:
            function = getattr(library, f"hil_controller_{name}")
        except AttributeError:
            right = "hil_controller.h has all six"
            raise ControllerError(f"{path}: lacks hil_controller_{name}; {right}") from None
        function.restype, function.argtypes = result, arguments
        functions[name] = function
    version = functions["version"]()
    if version != VERSION:
        right = f"build it with the hil_controller.h of version {VERSION}"
        raise ControllerError(f"{path}: is of version {version}; {right}")
    return functions


class _CallByCtypes:
    """An `Advance` where there is no machine code for it.

    Args:
        function: the library's.
        sent: where it writes frames that it sends.
    """

    def __init__(self, function: Any, sent: bytearray) -> None:  # noqa: ANN401 - of ctypes
        self._function = function
        self._received, self._count = bytearray(_ROOM * _SIZE_OF_FRAME), _SIZE()
        self._received_at, self._sent_at = (
            ctypes.addressof(ctypes.c_char.from_buffer(each)) for each in (self._received, sent)
        )
        self._counted = ctypes.byref(self._count)

    def __call__(
        self,
        _address: int,
        instance: int,
        until: int,
        received: Sequence[TimedFrame],
        _sent: bytearray,
        _timed: type[TimedFrame],
        _frame: type[Frame],
    ) -> tuple[int, int, list[TimedFrame] | None]:
        place = 0
        for time, (can_id, data, is_remote, is_extended, bus, _) in received:
            flags = is_extended * _EXTENDED | is_remote * _REMOTE
            _pack(self._received, place, time, can_id, bus, len(data), flags, data)
            place += _SIZE_OF_FRAME
        state = self._function(
            instance, until, self._received_at, len(received), self._sent_at, _ROOM, self._counted
        )
        return state, self._count.value, None


class LibraryController:
    """An instance of a library.

    Args:
        path: of the library.
        settings: texts by name.

    Attributes:
        has_begun: False while it says that it is starting.

    Raises:
        ControllerError: the library is not right, or makes no instance.
    """

    def __init__(self, path: Path, settings: Mapping[str, str]) -> None:
        path = path.resolve()
        if not path.is_file():
            raise ControllerFileError(f"{path}: there is no such library; build it first")
        self._path, self._call = path, load_library(path, path.stat().st_mtime_ns)
        words = [f"{name}={value}".encode() for name, value in settings.items()]
        given = (ctypes.c_char_p * (len(words) + 1))(*words, None)
        self._instance: int = self._call["create"](given) or 0
        if not self._instance:
            why = " ".join(self._say(0).split()) or "it gives no reason"
            raise ControllerError(f"{path}: makes no instance: {why}")
        self.has_begun = True
        self._lines: deque[str] = deque(maxlen=SHOWN_LINES)
        self._sent = bytearray(_ROOM * _SIZE_OF_FRAME)
        function = self._call["advance"]
        self._address: int = ctypes.cast(function, _POINTER).value or 0
        self._advance: Advance = _advance or _CallByCtypes(function, self._sent)

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Let it live until a moment; see `Controller`."""
        sent: list[TimedFrame] = []
        if len(received) <= _ROOM:
            self._live(until, received, sent)
        else:
            for start in range(0, len(received), _ROOM):
                self._live(until, received[start : start + _ROOM], sent)
        return sent

    def reset(self) -> None:
        """Take its power away and give it back."""
        self._call["reset"](self._instance)

    def tail(self) -> str:
        """The last lines of what it had to say."""
        self._listen()
        return "\n".join(self._lines)

    def close(self) -> None:
        """Destroy the instance; the library stays loaded."""
        self._listen()
        instance, self._instance = self._instance, 0
        if instance:
            self._call["destroy"](instance)

    def _live(self, until: int, received: Sequence[TimedFrame], sent: list[TimedFrame]) -> None:
        """Let it live with frames that it has room for; put what it sends behind `sent`."""
        state, count, frames = self._advance(
            self._address, self._instance, until, received, self._sent, TimedFrame, Frame
        )
        if count:
            sent += self._take(count, until) if frames is None else frames
        if state:
            self._look_at(state, sent)
        elif not self.has_begun:
            self.has_begun = True

    def _take(self, count: int, until: int) -> list[TimedFrame]:
        """Return the frames that it has sent.

        Raises:
            ControllerError: what it says cannot be.
        """
        if count > _ROOM:
            wrong = f"says that it sent {count} frames, and had room for {_ROOM}"
            raise ControllerError(f"{self._path}: {wrong}")
        frames: list[TimedFrame] = []
        end = count * _SIZE_OF_FRAME
        for time, can_id, bus, length, flags, data in _iter_unpack(self._sent[:end]):
            if (
                length > 8
                or flags > 3
                or time > until
                or can_id >> (29 if flags & _EXTENDED else 11)
            ):
                what = f"identifier 0x{can_id:X}, length {length}, flags {flags}"
                wrong = f"sent no CAN frame: {what}, at {time * 1e-9:g} s"
                raise ControllerError(f"{self._path}: {wrong}")
            is_remote = bool(flags & _REMOTE)
            payload = b"" if is_remote else data[:length]
            fields = (can_id, payload, is_remote, bool(flags & _EXTENDED), bus, 0)
            frames.append(make_timed(TimedFrame, (time, make_frame(Frame, fields))))
        return frames

    def _look_at(self, state: int, sent: Sequence[TimedFrame]) -> None:
        """Take note of a state other than that it runs.

        Raises:
            ControllerEnd: it has ended.
            ControllerError: it has failed, or says what is no state.
        """
        if state == State.STARTING:
            self.has_begun = False
            return
        self._listen()
        last = self._lines[-1] if self._lines else ""
        if state == State.ENDED:
            raise ControllerEnd(last, sent)
        why = last or ("it gives no reason" if state == State.FAILED else f"answers {state}")
        raise ControllerError(f"{self._path}: has failed: {why}")

    def _listen(self) -> None:
        if self._instance:
            self._lines.extend(self._say(self._instance).splitlines())

    def _say(self, instance: int) -> str:
        text: bytes | None = self._call["message"](instance or None)
        return (text or b"").decode(errors="replace").strip()
