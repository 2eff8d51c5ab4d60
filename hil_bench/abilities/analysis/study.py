"""Results of an analysis: facts to read, tables as CSV, figures as PNG and SVG.

Nothing in the files depends on the time or the place of the run: the same input gives the same
bytes.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.figures import ResponseCurve
from hil_bench.abilities.analysis.frequency_response import decibel
from hil_bench.figure_style import write_figure
from hil_bench.outside.recording.block_file import RecordingFile
from hil_bench.outside.recording.channels import Channel, Recording, recording_dtype

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Fact(NamedTuple):
    """One number that an analysis found.

    Attributes:
        name: of the quantity.
        value: in that unit.
        unit: its symbol; ``-`` for a pure number.
    """

    name: str
    value: float | complex
    unit: str

    @property
    def text(self) -> str:
        """The value as people read it."""
        if isinstance(self.value, complex) and self.value.imag:
            sign = "-" if self.value.imag < 0.0 else "+"
            return f"{self.value.real:.6g} {sign} {abs(self.value.imag):.6g}j"
        return f"{self.value.real:.6g}"

    @property
    def plain(self) -> float | list[float] | None:
        """The value as JSON has it: complex as real and imaginary part, infinite as null."""
        if isinstance(self.value, complex):
            return [self.value.real, self.value.imag]
        return float(self.value) if math.isfinite(self.value) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """The results of one analysis.

    Attributes:
        title: in a few words.
        facts: the numbers.
        tables: by the name of their file; structured arrays with the units as metadata.
        figures: by the name of their file; each draws itself.
    """

    title: str
    facts: Sequence[Fact]
    tables: Mapping[str, Recording]
    figures: Mapping[str, Callable[[], "Figure"]]


def make_table(columns: Mapping[Channel, npt.ArrayLike]) -> Recording:
    """Return columns of one length as a structured array that knows their units."""
    arrays = {channel.name: np.asarray(values) for channel, values in columns.items()}
    table = np.empty(len(next(iter(arrays.values()))), dtype=recording_dtype([*columns]))
    for name, values in arrays.items():
        table[name] = values
    return table


def write_study(study: Study, directory: Path) -> list[Path]:
    """Write tables as CSV and figures as PNG and SVG into a directory; return the files."""
    files = []
    for name, table in study.tables.items():
        path = directory / f"{name}.csv"
        with RecordingFile(path) as file:
            file.write(table)
        files.append(path)
    for name, draw in study.figures.items():
        files += write_figure(draw, directory / name)
    return files


# Frequency responses as a table.

VELOCITY_PER_OPENING = "(m/s)/m"
"""Unit of the gain from spool or orifice to piston velocity."""


def response_table(curves: Sequence[ResponseCurve]) -> Recording:
    """Return gain [dB], phase and coherence of curves that share their frequencies."""
    columns = {Channel("frequency", "Hz"): curves[0].frequencies}
    for curve in curves:
        label = curve.label.replace("$", "").replace("\\,", " ").replace("\\", "")
        columns[Channel(f"{label}: gain", "dB")] = decibel(curve.response)
        columns[Channel(f"{label}: phase", "deg")] = np.angle(curve.response, deg=True)
        if curve.coherence is not None:
            columns[Channel(f"{label}: coherence", "-")] = curve.coherence
    return make_table(columns)
