import pytest


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HIL_BENCH_CONFIG", raising=False)
    monkeypatch.delenv("HIL_BENCH_SEED", raising=False)
