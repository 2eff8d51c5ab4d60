"""What is read from files: any content is what it should be, or one of our errors in one line."""

import atexit
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

import hil_drivers.node
from hil_bench import HilBenchError, load_config, read_frames
from hil_bench.abilities.commissioning.plan import load_plan
from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.abilities.modbus.map_files import load_register_map
from hil_bench.abilities.recording.mdf_reader import read_mdf
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.srdo.nodes import services
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.storage import StoredParameters
from hil_drivers.errors import DriverError
from hil_drivers.modbus.register_map import RegisterMap as DriverMap

MOST_FRAMES = 1000

_FOLDER = Path(mkdtemp(prefix="fuzz-"))
atexit.register(shutil.rmtree, _FOLDER, ignore_errors=True)


def _given(name: str, data: bytes) -> Path:
    path = _FOLDER / name
    path.write_bytes(data)
    return path


def _read(path: Path, *readers: Callable[[Path], object]) -> None:
    for reader in readers:
        said = _message_of(reader, path)
        assert all(line.isprintable() for line in said.splitlines()), said


def _message_of(reader: Callable[[Path], object], path: Path) -> str:
    try:
        reader(path)
    except (HilBenchError, DriverError) as error:
        return str(error)
    return "is read"


def _boot(path: Path) -> None:
    """Load an EDS file, and let the device of it live for a while."""
    objects = load_eds(path, 5)
    node = Node(objects, 5, added=services(objects))
    node.start(0)
    for now in range(3):
        node.expire(now)
        node.transmit_pdos(now, lambda _frame: None)
        node.serve(now, lambda _frame: None)


def eds(data: bytes) -> None:
    """An EDS file, as a device, as the checker and as a driver read it."""
    _read(
        _given("fuzz.eds", data), _boot, check_eds, lambda path: hil_drivers.node.load_eds(path, 5)
    )


def bench_toml(data: bytes) -> None:
    """A configuration, a commissioning plan."""
    _read(_given("bench.toml", data), load_config, load_plan)


def register_map(data: bytes) -> None:
    """A register map, as both sides read it."""
    _read(_given("map.toml", data), load_register_map, DriverMap)


def mdf(data: bytes) -> None:
    """A recording in MF4."""
    _read(_given("fuzz.mf4", data), read_mdf)


def signals_csv(data: bytes) -> None:
    """Signals as CSV."""
    _read(_given("fuzz.csv", data), read_recording)


def frames(data: bytes) -> None:
    """Bus frames in each of their formats; the first byte says which."""
    suffix = (".log", ".asc", ".blf")[data[0] % 3] if data else ".log"
    _read(
        _given(f"fuzz{suffix}", data[1:]),
        lambda path: [frame for _, frame in zip(range(MOST_FRAMES), read_frames(path))],  # noqa: B905
    )


def stored_parameters(data: bytes) -> None:
    """What a device has stored."""
    _read(_given("fuzz.json", data), lambda path: StoredParameters.decode(path.read_bytes()))
