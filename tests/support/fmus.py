"""FMUs of our own: `slider.c` for FMI 2.0 and 3.0, and a control law written by PythonFMU."""

import functools
import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

SOURCE = Path(__file__).with_name("slider.c")
CAN_BUILD = shutil.which("gcc") is not None and importlib.util.find_spec("fmpy") is not None

VARIABLES = (
    ("x", "output", "continuous", 'unit="mm"', 'min="-100" max="100"'),
    ("v", "local", "continuous", 'unit="mm/s"', ""),
    ("u", "input", "continuous", "", 'start="0"'),
    ("F", "input", "continuous", 'unit="N"', 'start="0"'),
    ("gain", "parameter", "fixed", "", 'start="0.5"'),
    ("damping", "parameter", "fixed", "", 'start="1000"'),
    ("fails_at", "parameter", "fixed", "", 'start="1e9"'),
    ("breaks_at", "parameter", "fixed", "", 'start="1e9"'),
    ("crashes_at", "parameter", "fixed", "", 'start="1e9"'),
    ("hangs_at", "parameter", "fixed", "", 'start="1e9"'),
)
UNITS = "".join(f'<Unit name="{name}"/>' for name in ("mm", "mm/s", "N"))


def describe_2(step: str = "", slave: str = 'canHandleVariableCommunicationStepSize="true"') -> str:
    """Return the description of the slider for FMI 2.0."""
    variables = (
        "".join(
            f'<ScalarVariable name="{name}" valueReference="{number}" causality="{causality}" '
            f'variability="{variability}"><Real {unit} {more}/></ScalarVariable>'
            for number, (name, causality, variability, unit, more) in enumerate(VARIABLES)
        )
        + '<ScalarVariable name="count" valueReference="99" causality="output"><Integer/>'
        "</ScalarVariable>"
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" '
        'modelName="Slider" guid="{slider}">'
        f'<CoSimulation modelIdentifier="slider" {slave}/>'
        f"<UnitDefinitions>{UNITS}</UnitDefinitions>{step}"
        f"<ModelVariables>{variables}</ModelVariables>"
        '<ModelStructure><Outputs><Unknown index="1"/></Outputs></ModelStructure>'
        "</fmiModelDescription>"
    )


def describe_3(slave: str = 'canHandleVariableCommunicationStepSize="true"') -> str:
    """Return the description of the slider for FMI 3.0."""
    variables = "".join(
        f'<Float64 name="{name}" valueReference="{number}" causality="{causality}" '
        f'variability="{variability}" {unit} {more}/>'
        for number, (name, causality, variability, unit, more) in enumerate(VARIABLES)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" '
        'modelName="Slider" instantiationToken="{slider}">'
        f'<CoSimulation modelIdentifier="slider" {slave}/>'
        f"<UnitDefinitions>{UNITS}</UnitDefinitions>"
        f"<ModelVariables>{variables}</ModelVariables>"
        '<ModelStructure><Output valueReference="0"/></ModelStructure></fmiModelDescription>'
    )


def _rest(version: int) -> list[str]:
    """Return the functions that FMPy wants a library to have, and the slider does not."""
    from fmpy.fmi2 import FMU2Slave  # noqa: PLC0415
    from fmpy.fmi3 import FMU3Slave  # noqa: PLC0415

    slave = FMU2Slave if version == 2 else FMU3Slave
    own = set(re.findall(rf"\b(fmi{version}\w+)\(", SOURCE.read_text()))
    return [name for name in dir(slave) if name.startswith(f"fmi{version}") and name not in own]


@functools.cache
def library(version: int) -> bytes:
    """Return the slider's library for this machine."""
    import fmpy  # noqa: PLC0415 - where it is not installed, nobody asks

    headers = Path(fmpy.__file__).parent / "c-code"
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "slider.so"
        stubs = Path(folder) / "stubs.c"
        stubs.write_text("".join(f"int {name}(void) {{ return 3; }}\n" for name in _rest(version)))
        flags = [f"-I{headers}", *(["-DFMI3"] if version == 3 else [])]
        command = [
            "gcc",
            "-shared",
            "-fPIC",
            "-O1",
            "-w",
            *flags,
            str(SOURCE),
            str(stubs),
            "-o",
            str(made),
            "-lm",
        ]
        subprocess.run(command, check=True)  # noqa: S603 - of our own
        return made.read_bytes()


def write_fmu(path: Path, version: int = 2, description: str = "", platform: str = "") -> Path:
    """Write the slider as an FMU."""
    import fmpy  # noqa: PLC0415

    own = fmpy.platform if version == 2 else fmpy.platform_tuple
    with zipfile.ZipFile(path, "w") as archive:
        told = description or (describe_2() if version == 2 else describe_3())
        archive.writestr("modelDescription.xml", told)
        archive.writestr(f"binaries/{platform or own}/slider.so", library(version))
    return path


# A law in mm as a tool would export it: the valve's overlap, and a gain per mm of error.
LAW = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Control(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = self.w = self.u = 0.0
        self.gain = 0.01
        for name in ("x", "w"):
            self.register_variable(Real(name, causality=Fmi2Causality.input, start=0.0))
        self.register_variable(Real("u", causality=Fmi2Causality.output))
        fixed = Fmi2Variability.fixed
        gain = Real("gain", causality=Fmi2Causality.parameter, variability=fixed, start=0.01)
        self.register_variable(gain)

    def do_step(self, current_time, step_size):
        error = self.w - self.x
        over = 0.0 if abs(error) < 0.1 else 23.0 if error > 0.0 else -23.0
        self.u = over + 100.0 * self.gain * error
        return True
"""


def write_law(folder: Path) -> Path:
    """Write the control law as `control.fmu`."""
    from pythonfmu.builder import FmuBuilder  # noqa: PLC0415 - an extra

    (folder / "control.py").write_text(LAW)
    searched = list(sys.path)
    made = Path(FmuBuilder.build_FMU(folder / "control.py", dest=folder))
    sys.path[:] = searched
    return made.rename(folder / "control.fmu")
