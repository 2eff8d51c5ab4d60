"""A Modbus client's link to a bench in virtual time: `VirtualBench.modbus_link`."""

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.server.register_server import RegisterServer
from hil_bench.abilities.modbus.server.session import EmbeddedLink
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.errors import ConfigError


def modbus_link(bench: VirtualBench, framing: object, *, is_serial: bool = False) -> EmbeddedLink:
    """Return a link for `hil_drivers.modbus.ModbusClient` to a bench.

    Args:
        bench: it.
        framing: the client's, as `hil_drivers.modbus.framing.TcpFraming`.
        is_serial: whether its frames are those of RTU.

    Raises:
        ConfigError: the bench has no Modbus server.
    """
    modbus = bench.bench.find(ModbusBinding)
    if modbus is None:
        raise ConfigError("modbus: there is no such table; give [modbus]")
    plan = modbus.plan
    server = RegisterServer(
        plan.units, plan.rows, plan.mailbox, bench.now, default_unit=plan.server.default_unit
    )
    period = bench.config.tick_ns * 1e-9
    return EmbeddedLink(server, bench.run, period, framing=framing, is_serial=is_serial)
