"""The drivers work where the bench is not installed."""

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).parents[3]

PROGRAM = """
import sys

# Nothing of this name can be imported, whatever is installed, or was once: uninstalled, the bench
# leaves the folders that hold Numba's machine code.
sys.modules["hil_bench"] = None

import hil_drivers
import hil_drivers.modbus
from hil_drivers.modbus.framing import TcpFraming

for name in hil_drivers.__all__:
    getattr(hil_drivers, name)


class Link:
    description, framing = "link", TcpFraming()

    def open(self, timeout): pass
    def close(self): pass
    def send(self, data): self.sent = data
    def receive(self, timeout):
        # 50 bar as a float, sample 1, status 0
        return self.sent[:5] + bytes([13]) + self.sent[6:7] + bytes.fromhex(
            "04 0A 42480000 00000001 0000"
        )


sensor = hil_drivers.modbus.PressureSensor(hil_drivers.modbus.ModbusClient(Link()), 2)
sensor.poll()
print(sensor.pressure)
assert [name for name in sys.modules if name.startswith("hil_bench")] == ["hil_bench"]
"""


def test_only_the_drivers_are_installed(tmp_path):
    for package in (ROOT / "drivers" / "hil_drivers", ROOT / "device_profiles"):
        shutil.copytree(package, tmp_path / package.name)
    # -S leaves out the .pth files by which an editable installation is found, -I the checkout.
    paths = [str(tmp_path), sysconfig.get_paths()["purelib"]]
    program = f"import sys\nsys.path += {paths!r}\n{PROGRAM}"
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-S", "-I", "-c", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert (ended.returncode, ended.stdout) == (0, "5000000.0\n"), ended.stderr
