"""`bench.toml` to frozen records: read, checked and converted to SI once."""

from hil_bench.bench.configuration.load import CONFIG_VARIABLE, load_config
from hil_bench.bench.configuration.loop import SEED_VARIABLE
from hil_bench.bench.configuration.records import BenchConfig, BusConfig
from hil_bench.config.settings import Origin, Setting
from hil_bench.devices.kinds.bindings import SinkConfig, SourceConfig
from hil_bench.devices.kinds.kind import NodeConfig
from hil_bench.outside.realtime.clock import OverrunPolicy, RealtimeConfig, RealtimePolicy
from hil_bench.plants.plant import AxisConfig

__all__ = [
    "CONFIG_VARIABLE",
    "SEED_VARIABLE",
    "AxisConfig",
    "BenchConfig",
    "BusConfig",
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
