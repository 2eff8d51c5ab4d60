"""A whole bench in virtual time."""

import pytest
from support.bus_side import BusSide


@pytest.fixture
def bus():
    """The built-in bench, seen from its bus."""
    return BusSide()
