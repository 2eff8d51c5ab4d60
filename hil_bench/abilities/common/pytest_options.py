"""Options of pytest, each on the command line or as an ini key of its name, and a test's bench."""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from hil_bench.bench.virtual_bench import VirtualBench

BENCH: "pytest.StashKey[VirtualBench]" = pytest.StashKey()
"""The key of the virtual bench of a test, by whichever fixture the test has got it."""


def add_options(
    parser: pytest.Parser,
    options: Mapping[str, tuple[str, str]],
    switches: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Add options, each with an ini key of its name.

    Args:
        parser: of pytest.
        options: name of the value and text for people, by the option's name.
        switches: text for people by the name.
    """
    group = parser.getgroup("hil-bench", "hil-bench: hydraulic axis behind CANopen devices")
    for name, (metavar, text) in options.items():
        group.addoption(f"--hil-{name}", metavar=metavar, help=text)
        parser.addini(_key(name), text)
    for name, text in switches.items():
        group.addoption(f"--hil-{name}", action="store_true", help=text)
        parser.addini(_key(name), text, type="bool", default=False)


def option(config: pytest.Config, name: str) -> Any:  # noqa: ANN401 - a text or, of a switch, True
    """Return an option, else the ini key of its name, else None."""
    return config.getoption(_key(name)) or config.getini(_key(name)) or None


def path_option(config: pytest.Config, name: str) -> Path | None:
    """Return the path in an option, else in the ini key of its name, else None.

    A relative one counts from the folder that pytest was started in; in an ini file, from the
    file's own.
    """
    if given := config.getoption(_key(name)):
        return config.invocation_params.dir / str(given)
    written = config.getini(_key(name))
    folder = config.inipath.parent if config.inipath else config.rootpath
    return folder / str(written) if written else None


def shown_path(config: pytest.Config, path: Path) -> str:
    """Return a path as reports show it: from the folder that pytest was started in."""
    start = config.invocation_params.dir
    return str(path.relative_to(start) if path.is_relative_to(start) else path)


def positive_option(config: pytest.Config, name: str) -> float | None:
    """Return the number in an option, else in the ini key of its name, else None.

    Raises:
        pytest.UsageError: it is no positive number.
    """
    text = option(config, name)
    if text is None:
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise pytest.UsageError(f"--hil-{name} {text}: give a positive number of seconds")
    return number


def seed_option(config: pytest.Config) -> int | None:
    """Return the seed in an option, else in the ini key, else None.

    Raises:
        pytest.UsageError: it is none.
    """
    text = option(config, "seed")
    if text is None:
        return None
    if not str(text).strip().isdecimal():
        raise pytest.UsageError(f"--hil-seed {text}: give an integer, 0 or more")
    return int(text)


def is_on(config: pytest.Config, name: str) -> bool:
    """Return True if a switch is on, by option or by ini key."""
    return bool(option(config, name))


def chosen_options(config: pytest.Config) -> str:
    """Return the chosen options, as in "seed 5, realtime"; empty without any."""
    names = [key[4:].replace("_", "-") for key in vars(config.option) if key.startswith("hil_")]
    values = {name: option(config, name) for name in names}
    return ", ".join(
        name if value is True else f"{name} {value}" for name, value in values.items() if value
    )


def versions() -> str:
    """Return the versions in use, as in "hil-bench 1.0.0, python-can 4.6.1"."""
    from importlib.metadata import version

    return ", ".join(f"{name} {version(name)}" for name in ("hil-bench", "python-can"))


def worker() -> str:
    """Return the number of this worker of pytest-xdist, "0" where it is not in use."""
    return os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")


def _key(name: str) -> str:
    """Return the name under which pytest keeps an option."""
    return f"hil_{name.replace('-', '_')}"
