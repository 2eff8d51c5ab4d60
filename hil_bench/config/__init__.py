"""`bench.toml` to frozen records: read, checked and converted to SI once."""

from hil_bench.config.choices import OverrunPolicy, RealtimePolicy
from hil_bench.config.load import CONFIG_VARIABLE, SEED_VARIABLE, load_config
from hil_bench.config.records import (
    BenchConfig,
    BusConfig,
    FaultConfig,
    ModbusConfig,
    ModbusUnitConfig,
    RealtimeConfig,
)
from hil_bench.kinds.bindings import SinkConfig, SourceConfig
from hil_bench.kinds.kind import NodeConfig
from hil_bench.plants.kind import AxisConfig
from hil_bench.tables.settings import Origin, Setting

__all__ = [
    "CONFIG_VARIABLE",
    "SEED_VARIABLE",
    "AxisConfig",
    "BenchConfig",
    "BusConfig",
    "FaultConfig",
    "ModbusConfig",
    "ModbusUnitConfig",
    "NodeConfig",
    "Origin",
    "OverrunPolicy",
    "RealtimeConfig",
    "RealtimePolicy",
    "Setting",
    "SinkConfig",
    "SourceConfig",
    "load_config",
]
