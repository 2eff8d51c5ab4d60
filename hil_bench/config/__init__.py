"""`bench.toml` to frozen records: read, checked and converted to SI once."""

from hil_bench.config.choices import (
    OverrunPolicy,
    PressureSource,
    Profile,
    Quantity,
    RealtimePolicy,
)
from hil_bench.config.load import CONFIG_VARIABLE, SEED_VARIABLE, load_config
from hil_bench.config.records import (
    AxisConfig,
    BenchConfig,
    BusConfig,
    EncoderConfig,
    FaultConfig,
    GenericConfig,
    ModbusConfig,
    ModbusUnitConfig,
    NodeConfig,
    PressureConfig,
    RealtimeConfig,
    SinkConfig,
    SourceConfig,
    ValveConfig,
)
from hil_bench.tables.settings import Origin, Setting

__all__ = [
    "CONFIG_VARIABLE",
    "SEED_VARIABLE",
    "AxisConfig",
    "BenchConfig",
    "BusConfig",
    "EncoderConfig",
    "FaultConfig",
    "GenericConfig",
    "ModbusConfig",
    "ModbusUnitConfig",
    "NodeConfig",
    "Origin",
    "OverrunPolicy",
    "PressureConfig",
    "PressureSource",
    "Profile",
    "Quantity",
    "RealtimeConfig",
    "RealtimePolicy",
    "Setting",
    "SinkConfig",
    "SourceConfig",
    "ValveConfig",
    "load_config",
]
