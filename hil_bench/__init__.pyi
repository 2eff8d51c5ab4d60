from hil_bench.abilities.campaign.table import run_campaign as run_campaign
from hil_bench.abilities.controllers.seam import Controller as Controller
from hil_bench.abilities.controllers.seam import ControllerEnd as ControllerEnd
from hil_bench.abilities.controllers.seam import ControllerKind as ControllerKind
from hil_bench.abilities.controllers.seam import Surroundings as Surroundings
from hil_bench.abilities.controllers.seam import TimedFrame as TimedFrame
from hil_bench.abilities.faults.attached import AttachedFaults
from hil_bench.abilities.faults.faults import Faults as Faults
from hil_bench.abilities.live.attached import AttachedBench as _AttachedBench
from hil_bench.abilities.recording.frames import read_frames as read_frames
from hil_bench.abilities.recording.reading import open_recording as open_recording
from hil_bench.abilities.recording.report import RecordingReport
from hil_bench.abilities.recording.report import RecordingWish as RecordingWish
from hil_bench.bench.assembly import embedded_bus as embedded_bus
from hil_bench.bench.configuration import BenchConfig as BenchConfig
from hil_bench.bench.configuration import load_config as load_config
from hil_bench.bench.virtual_bench import VirtualBench as _VirtualBench
from hil_bench.errors import BusError as BusError
from hil_bench.errors import ConfigError as ConfigError
from hil_bench.errors import HilBenchError as HilBenchError
from hil_bench.errors import WaitTimeoutError as WaitTimeoutError
from hil_bench.outside.recording.signal_table import SignalTable as SignalTable

# Both with the attributes that abilities bring.

class AttachedBench(_AttachedBench):
    @property
    def faults(self) -> AttachedFaults: ...

class VirtualBench(_VirtualBench):
    @property
    def faults(self) -> Faults: ...
    @property
    def recording(self) -> RecordingReport | None: ...

def attach(name: str | None = None, *, timeout: float = 10.0) -> AttachedBench: ...

__version__: str
