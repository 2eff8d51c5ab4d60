import pytest

from hil_bench.plants.hydraulic_cylinder.model import paper_parameters


@pytest.fixture
def table_1():
    return paper_parameters()
