"""Recorded signals as people handle them: in a notebook, with pandas, as a picture."""

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from hil_bench.ability import given_to
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Recording, recording_channels

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]
    from matplotlib.figure import Figure

_SHOWN_ROWS = 5  # of the beginning, and as many of the end


class SignalTable(np.ndarray[Any, np.dtype[np.void]]):
    """A structured array, a row a tick: `time` [s] first, then a field a signal in its SI unit.

    ``table["axis1.P_A"]`` is a plain array of float64, shape (rows,). A notebook shows the table
    with its units.
    """

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401 - as ndarray's
        """Return rows as a table, and a field as a plain array.

        Raises:
            ValueError: there is no such field; it names the nearest.
        """
        if isinstance(key, str) and key not in (names := self.dtype.names or ()):
            raise ValueError(f"no signal {quote(key)}; the nearest is {find_nearest(key, names)}")
        found = super().__getitem__(key)
        if isinstance(found, SignalTable) and found.dtype.names is None:
            return found.view(np.ndarray)
        return found

    @property
    def units(self) -> dict[str, str]:
        """The SI unit of each field."""
        return {channel.name: channel.unit for channel in recording_channels(self)}

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas DataFrame, a column a signal, indexed by `time` [s].

        The units are in its ``attrs["units"]``.

        Raises:
            ConfigError: pandas is not installed.
        """
        try:
            import pandas as pd  # noqa: PLC0415 - whoever calls this has it
        except ImportError:
            raise ConfigError(
                "to_pandas needs pandas; install it with: pip install 'hil-bench[notebook]'"
            ) from None
        columns = {name: self[name] for name in self.units}
        frame = pd.DataFrame(columns).set_index(TIME.name)
        frame.attrs["units"] = self.units
        return frame

    def plot(self, *signals: str) -> "Figure":
        """Return a figure: the motion of the axes, or the signals that are named.

        Args:
            signals: names, with wildcards as in ``axis1.P_*``; a panel a unit.

        Raises:
            ConfigError: a name fits no signal, or nothing here draws.
        """
        for module in given_to("picture"):
            figure: Figure = module.table_figure(self, signals)
            return figure
        raise ConfigError("nothing here draws: the ability recording is missing")

    def _repr_html_(self) -> str:
        """Return the table for a notebook: names, units, the first and the last rows."""
        names = list(self.units)
        rows = [*self[:_SHOWN_ROWS], *self[max(_SHOWN_ROWS, len(self) - _SHOWN_ROWS) :]]
        lines = [
            "<tr>" + "".join(f"<th>{escape(name)}</th>" for name in names) + "</tr>",
            "<tr>"
            + "".join(f"<th>[{escape(unit)}]</th>" for unit in self.units.values())
            + "</tr>",
            *(
                "<tr>" + "".join(f"<td>{row[name]:.6g}</td>" for name in names) + "</tr>"
                for row in rows
            ),
        ]
        return f"<table>{''.join(lines)}</table><p>{len(self)} rows</p>"


def as_table(recording: Recording) -> SignalTable:
    """Return the same rows with the face of a `SignalTable`."""
    return recording.view(SignalTable)
