from pathlib import Path

import pytest


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes bench.toml in a directory of its own, which is the working directory."""
    monkeypatch.chdir(tmp_path)

    def write_file(text):
        path = Path("bench.toml")
        path.write_text(text, encoding="utf-8")
        return path

    return write_file
