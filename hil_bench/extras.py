"""Packages that only some abilities need."""

import importlib.util

from hil_bench.errors import ConfigError


def require_extra(package: str, what: str, extra: str = "analysis") -> None:
    """Refuse to go on without an optional package.

    Args:
        package: the package's name.
        what: needs it, as in ``"a figure"``.
        extra: of the distribution, that has it.

    Raises:
        ConfigError: it is not installed.
    """
    if importlib.util.find_spec(package) is None:
        raise ConfigError(
            f"{what} needs {package}; install it with: pip install 'hil-bench[{extra}]'"
        )
