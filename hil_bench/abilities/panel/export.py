"""Export of the scope's signals as measured data: MF4, written as recordings are."""

import json

import numpy as np

from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Channel, recording_dtype
from hil_bench.outside.recording.mdf_writer import MdfFile
from hil_bench.scratch import scratch_folder

MOST_BYTES = 1 << 26
"""Longest request [byte]: two minutes of 60 channels at 1 kHz."""

_MOST_CHANNELS = 1000
_MOST_NAME = 200
_WRONG = "mf4: give a line of JSON with comment and channels, then rows of float64"


def make_mf4(body: bytes) -> bytes:
    """Return an MF4 file of the rows that a page holds.

    Args:
        body: a line of JSON, ``{"comment": "...", "channels": [["axis1.P_A", "Pa"]]}``, and behind
            it rows of float64, little-endian: the time [s], then a value a channel in its unit.

    Raises:
        ConfigError: it is something else.
    """
    head, _, rows = body.partition(b"\n")
    try:
        content = json.loads(head)
        comment, given = str(content["comment"]), content["channels"]
        channels = [Channel(_name(name), _name(unit)) for name, unit in given]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ConfigError(_WRONG) from None
    names = {TIME.name, *(channel.name for channel in channels)}
    if len(names) != 1 + len(channels) or len(channels) > _MOST_CHANNELS:
        raise ConfigError(f"mf4: give up to {_MOST_CHANNELS} channels, each with another name")
    dtype = recording_dtype((TIME, *channels))
    if len(rows) % dtype.itemsize:
        raise ConfigError(f"{_WRONG}, {1 + len(channels)} values each")
    with scratch_folder() as folder:
        path = folder / "scope.mf4"
        file = MdfFile(path, (TIME, *channels), comment=comment)
        file.write_rows(np.frombuffer(rows, dtype="<f8").astype(np.float64).view(dtype))
        file.flush(durable=False)
        file.close()
        return path.read_bytes()


def _name(text: object) -> str:
    """Return a name or a unit.

    Raises:
        ValueError: it cannot be one.
    """
    if not isinstance(text, str) or len(text) > _MOST_NAME or not text.isprintable():
        raise ValueError
    return text
