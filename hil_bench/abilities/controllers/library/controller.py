"""An instance of a shared library, by ctypes: one call a tick, frames packed in buffers."""

import ctypes
from collections import deque
from collections.abc import Mapping, Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path
from struct import Struct
from typing import Any

from hil_bench.abilities.controllers.seam import ControllerEnd, TimedFrame, make_timed
from hil_bench.canopen_device.frame import Frame, make_frame
from hil_bench.errors import ControllerError

VERSION = 1
SHOWN_LINES = 20
"""Lines of its output that messages show."""

_ROOM = 256  # frames of a call
_FRAME = Struct("=qIBBBx8s")  # struct hil_frame
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
def load_library(path: Path, _changed: int) -> dict[str, Any]:
    """Return the functions of a library by their short names.

    Args:
        path: of the library.
        _changed: when its file was last changed: another file is another library.

    Raises:
        ControllerError: it cannot be loaded, lacks a function or is of another version.
    """
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise ControllerError(f"{path}: cannot be loaded: {error}") from None
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
            raise ControllerError(f"{path}: there is no such library; build it first")
        self._path, self._call = path, load_library(path, path.stat().st_mtime_ns)
        words = [f"{name}={value}".encode() for name, value in settings.items()]
        self._instance = self._call["create"]((ctypes.c_char_p * (len(words) + 1))(*words, None))
        if not self._instance:
            why = self._say(None) or "says not why"
            raise ControllerError(f"{path}: makes no instance: {why}")
        self.has_begun = True
        self._lines: deque[str] = deque(maxlen=SHOWN_LINES)
        self._received, self._sent = bytearray(_ROOM * _FRAME.size), bytearray(_ROOM * _FRAME.size)
        self._count = _SIZE()
        self._places = [
            ctypes.addressof(ctypes.c_char.from_buffer(each))
            for each in (self._received, self._sent)
        ]
        self._counted = ctypes.byref(self._count)
        self._advance = self._call["advance"]

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Let it live until a moment; see `Controller`."""
        sent: list[TimedFrame] = []
        pack = _FRAME.pack_into
        for start in range(0, len(received) or 1, _ROOM):
            part = received[start : start + _ROOM]
            place = 0
            for time, (can_id, data, is_remote, is_extended, bus, _) in part:
                flags = is_extended * _EXTENDED | is_remote * _REMOTE
                pack(self._received, place, time, can_id, bus, len(data), flags, data)
                place += _FRAME.size
            places = self._places
            state = self._advance(
                self._instance, until, places[0], len(part), places[1], _ROOM, self._counted
            )
            if count := self._count.value:
                sent += self._take(count, until)
            if state:
                self._look_at(state, sent)
            elif not self.has_begun:
                self.has_begun = True
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
        instance, self._instance = self._instance, None
        if instance:
            self._call["destroy"](instance)

    def _take(self, count: int, until: int) -> list[TimedFrame]:
        """Return the frames that it has sent.

        Raises:
            ControllerError: what it says cannot be.
        """
        if count > _ROOM:
            wrong = f"says that it sent {count} frames, and had room for {_ROOM}"
            raise ControllerError(f"{self._path}: {wrong}")
        frames = []
        for time, can_id, bus, length, flags, data in _FRAME.iter_unpack(
            self._sent[: count * _FRAME.size]
        ):
            is_extended = bool(flags & _EXTENDED)
            if length > 8 or can_id >> (29 if is_extended else 11) or flags > 3 or time > until:
                what = f"identifier 0x{can_id:X}, length {length}, flags {flags}"
                wrong = f"sent no CAN frame: {what}, at {time * 1e-9:g} s"
                raise ControllerError(f"{self._path}: {wrong}")
            is_remote = bool(flags & _REMOTE)
            payload = b"" if is_remote else data[:length]
            frame = make_frame(Frame, (can_id, payload, is_remote, is_extended, bus, 0))
            frames.append(make_timed(TimedFrame, (time, frame)))
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
        why = last or ("says not why" if state == State.FAILED else f"answers {state}")
        raise ControllerError(f"{self._path}: has failed: {why}")

    def _listen(self) -> None:
        if self._instance:
            self._lines.extend(self._say(self._instance).splitlines())

    def _say(self, instance: int | None) -> str:
        text: bytes | None = self._call["message"](instance)
        return (text or b"").decode(errors="replace").strip()
