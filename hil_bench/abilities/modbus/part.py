"""Modbus as a part of a bench: from its table to the server of a run."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.map_files import ModbusConfig
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.session.session import Session

if TYPE_CHECKING:
    from hil_bench.abilities.modbus.serving import OpenModbus


@dataclass(frozen=True, slots=True)
class ModbusPart(ModbusConfig):
    """The part that the table ``[modbus]`` describes; `ModbusConfig` is its data.

    Attributes:
        real_time_only: why clients can be served in real time only.
        is_fitted: True: registers want what the devices have.
    """

    is_fitted: ClassVar[bool] = True

    real_time_only: ClassVar[str] = (
        "Modbus clients ask in real time, and bench time would stand while they do; "
        "leave --modbus and [modbus] out"
    )

    @property
    def lines(self) -> tuple[str, ...]:
        """No line: where clients find the server is known once it is open."""
        return ()

    def extension(self, config: BenchConfig, bench: Bench) -> ModbusBinding:
        """Return the binding of the registers to a bench; `ConfigError` where one has no source."""
        return ModbusBinding(config, bench)

    @contextmanager
    def attached(self, session: Session, config: BenchConfig) -> Iterator[None]:  # noqa: ARG002 - of every part
        """Exchange values and writes in each tick of a session.

        Yields:
            When it is so.
        """
        session.watch(ticks=session.bench.part(ModbusBinding).exchange)
        yield

    def served(
        self,
        session: Session,
        config: BenchConfig,  # noqa: ARG002 - of every such part
    ) -> "AbstractContextManager[OpenModbus]":
        """Serve clients in real time, by a process of its own."""
        from hil_bench.abilities.modbus.serving import open_modbus  # noqa: PLC0415 - for runs alone

        return open_modbus(self, session)
