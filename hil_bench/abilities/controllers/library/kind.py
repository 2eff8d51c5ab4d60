"""The kind `library`: a shared library with the six functions of `hil_controller.h`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import as_table, describe, text
from hil_bench.errors import ConfigError


def settings_table(value: object) -> dict[str, str]:
    """Return the settings of a library as texts.

    Raises:
        ConfigError: the value is something else.
    """
    right = 'write it as { target_mm = 50, name = "left" }'
    texts = {}
    for name, each in as_table(value, right).items():
        if not isinstance(each, (str, int, float)):
            raise ConfigError(f"{name}: {describe(each)} is no setting; {right}")
        word = str(int(each)) if isinstance(each, bool) else str(each)
        if "\0" in name + word or "=" in name:
            raise ConfigError(f"{name!a}: cannot be passed to a library; {right}")
        texts[name] = word
    return texts


class LibraryKind(ControllerKind):
    """A shared library."""

    name = "library"
    summary = "a shared library with the functions of hil_controller.h"
    uses_files = False
    can_branch = True  # a library's memory is its process's
    is_native = is_inside = True
    keys = (
        Key("library", text, example='"build/libaxis.so"'),
        Key("settings", settings_table, {}),
    )

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return nothing: a library may be built between the check and the run."""
        return ()

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Load the library, once, and make an instance."""
        from hil_bench.abilities.controllers.library.controller import (  # noqa: PLC0415 - ctypes
            LibraryController,
        )

        words = {name: surroundings.filled(each) for name, each in settings["settings"].items()}
        return LibraryController(surroundings.folder / settings["library"], words)


KIND = LibraryKind()
