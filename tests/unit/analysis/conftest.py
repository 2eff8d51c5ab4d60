import pytest

from hil_bench.plant import PlantParameters, paper_parameters


@pytest.fixture
def table_1() -> PlantParameters:
    return paper_parameters()
