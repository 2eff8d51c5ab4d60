import pytest

from hil_bench.plants.hydraulic_cylinder.model import PlantParameters, paper_parameters


@pytest.fixture
def table_1() -> PlantParameters:
    return paper_parameters()
