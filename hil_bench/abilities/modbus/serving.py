"""The Modbus server as runs by the clock start it."""

import contextlib
import importlib.util
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.map_files import ModbusConfig
from hil_bench.bench.session import Session
from hil_bench.cli.helpers import Helper
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from hil_bench.abilities.modbus.server.process import Endpoints, ModbusProcess


class OpenModbus(NamedTuple):
    """The Modbus server.

    Attributes:
        lines: where clients find it.
        helpers: its process.
    """

    lines: Sequence[str] = ()
    helpers: Sequence[Helper] = ()


class ModbusHelper:
    """The server's process, as the loop looks after it.

    Args:
        config: of the server.
        server: it runs.
    """

    name = "Modbus server"
    loss = "its clients are cut off; a valve that they command is left to its watchdog"
    is_needed = True

    def __init__(self, config: ModbusConfig, server: "ModbusProcess") -> None:
        self._config = config
        self._server = server

    def ending(self) -> str | None:
        """Return the way it ended; None while it runs."""
        return self._server.ending()

    def restart(self) -> str:
        """Start it again, at the TCP port that it had; return where it is."""
        self._server.restart()
        places = place_lines(self._config, self._server.endpoints)
        return ", ".join(line.removeprefix("modbus ") for line in places)


@contextlib.contextmanager
def open_modbus(modbus: ModbusConfig, session: Session) -> Iterator[OpenModbus]:
    """Start the Modbus server of a bench, and have each tick of its session serve it.

    Yields:
        The server.
    """
    require_pymodbus()
    from hil_bench.abilities.modbus.server.process import ModbusProcess  # noqa: PLC0415 - an extra

    binding = session.bench.part(ModbusBinding)
    session.watch(ticks=binding.exchange)
    with ModbusProcess(binding.plan) as server:
        lines = endpoint_lines(modbus, server.endpoints)
        yield OpenModbus(lines, [ModbusHelper(modbus, server)])


def require_pymodbus() -> None:
    """Say which extra is missing, where it is.

    Raises:
        ConfigError: pymodbus is not installed.
    """
    if importlib.util.find_spec("pymodbus") is None:
        raise ConfigError("Modbus needs pymodbus: pip install 'hil-bench[modbus]'")


def endpoint_lines(config: ModbusConfig, endpoints: "Endpoints") -> list[str]:
    """Return the addresses of the server, a line each, and its units."""
    units = ", ".join(f"{unit.unit_id} {unit.name}" for unit in config.units)
    return [*place_lines(config, endpoints), f"units  {units}"]


def place_lines(config: ModbusConfig, endpoints: "Endpoints") -> list[str]:
    """Return the addresses of the server, a line each."""
    lines, serial = [], config.server.serial
    if endpoints.port is not None:
        lines.append(f"modbus TCP {config.server.host}:{endpoints.port}")
    if serial is not None:
        line = f", {serial.baud_rate} bit/s, parity {serial.parity}"
        is_pseudo = serial.port == "pty"  # which has neither
        lines.append(f"modbus RTU {endpoints.serial_port}{'' if is_pseudo else line}")
    return lines
