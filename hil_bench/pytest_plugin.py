"""The plugin of pytest: fixtures, options and hooks that abilities bring.

The module loads in every pytest run of its environment, so it imports nothing of weight.
"""

import pytest


def pytest_addoption(pluginmanager: pytest.PytestPluginManager) -> None:
    """Register the plugins of abilities, which add their options then."""
    from importlib import import_module

    from hil_bench.ability import own_abilities

    for ability in own_abilities():
        if ability.fixtures:
            pluginmanager.register(import_module(ability.fixtures), ability.fixtures)
