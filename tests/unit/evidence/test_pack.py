"""A pack is written whole or not at all, and a changed one is found."""

import hashlib
import json
from pathlib import Path

import pytest

import hil_bench
from hil_bench.abilities.evidence.content import summarise
from hil_bench.abilities.evidence.pack import (
    MANIFEST,
    check_folder,
    examine_software,
    verify_pack,
    write_pack,
)
from hil_bench.errors import ConfigError

FILES = {"index.html": b"<p>", "evidence.json": b"{}", "inputs/bench.toml": b"[bench]\n"}
DIGEST = (
    "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"  # printf '{}' | sha256sum
)


@pytest.fixture
def pack(tmp_path):
    write_pack(tmp_path / "pack", FILES)
    return tmp_path / "pack"


def test_a_pack_as_it_was_written_is_whole(pack, tmp_path):
    assert verify_pack(pack) == []
    assert [path.name for path in tmp_path.iterdir()] == ["pack"]  # nothing beside it
    files = json.loads((pack / MANIFEST).read_text())["files"]
    assert files["evidence.json"] == DIGEST


def test_each_file_that_was_touched_is_named(pack):
    (pack / "index.html").write_bytes(b"<P>")
    (pack / "inputs" / "bench.toml").unlink()
    (pack / "inputs" / "more.toml").touch()
    assert verify_pack(pack) == [
        "index.html: was changed",
        "inputs/bench.toml: is missing",
        "inputs/more.toml: was added",
    ]


def test_a_link_in_place_of_a_file_is_a_change(pack, tmp_path):
    copy = (pack / "index.html").rename(tmp_path / "copy.html")
    (pack / "index.html").symlink_to(copy)
    assert verify_pack(pack) == ["index.html: was changed"]


def test_a_manifest_that_was_made_anew_is_found_by_its_digest(tmp_path):
    digest = write_pack(tmp_path / "pack", FILES)
    manifest = tmp_path / "pack" / MANIFEST
    assert digest == hashlib.sha256(manifest.read_bytes()).hexdigest()
    assert verify_pack(tmp_path / "pack", digest.upper()) == []
    page = tmp_path / "pack" / "index.html"
    page.write_bytes(b"<P>")
    changed = json.loads(manifest.read_text())
    changed["files"]["index.html"] = hashlib.sha256(b"<P>").hexdigest()
    manifest.write_text(json.dumps(changed))
    assert verify_pack(tmp_path / "pack") == []
    (line,) = verify_pack(tmp_path / "pack", digest)
    assert line.startswith("manifest.json: was changed")


@pytest.mark.parametrize(
    "text", ["", "[]", '{"format": 1}', '{"format": 2, "files": {}}', "[" * 100_000, "\xff"]
)
def test_a_manifest_that_is_none_is_one_line(pack, text):
    (pack / MANIFEST).write_text(text, encoding="latin-1")
    (line,) = verify_pack(pack)
    assert line.startswith("manifest.json: was changed")


def test_a_missing_manifest_is_one_line(pack):
    (pack / MANIFEST).unlink()
    assert verify_pack(pack) == ["manifest.json: is missing"]


def test_a_manifest_opens_nothing_outside_the_pack(pack, tmp_path):
    (tmp_path / "secret").write_bytes(b"x")
    content = json.loads((pack / MANIFEST).read_text())
    content["files"]["../secret"] = hashlib.sha256(b"x").hexdigest()
    (pack / MANIFEST).write_text(json.dumps(content))
    assert verify_pack(pack) == ["../secret: is missing"]


def test_a_place_that_cannot_be_written_is_refused_before_the_checks(monkeypatch, tmp_path):
    def refuse(_path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(ConfigError, match=r"pack: cannot be written: Permission denied"):
        check_folder(tmp_path / "pack")


def test_a_manifest_that_is_too_large_is_not_read(pack):
    with (pack / MANIFEST).open("r+b") as file:
        file.truncate(10_000_001)
    assert verify_pack(pack) == ["manifest.json: was changed: it is too large"]


@pytest.mark.parametrize("kind", ["file", "link to a folder", "link to nothing"])
def test_what_is_no_folder_is_refused(tmp_path, kind):
    place, folder = tmp_path / "pack", tmp_path / "elsewhere"
    if kind == "file":
        place.touch()
    else:
        place.symlink_to(folder)
    if kind == "link to a folder":
        folder.mkdir()
    with pytest.raises(ConfigError, match="pack: is no folder; give the name of a new one"):
        check_folder(place)


def test_an_empty_folder_becomes_the_pack(tmp_path):
    write_pack(tmp_path, FILES)
    assert verify_pack(tmp_path) == []


def test_a_folder_that_is_not_empty_is_refused(pack):
    with pytest.raises(ConfigError, match="is not empty"):
        write_pack(pack, FILES)
    assert verify_pack(pack) == []


@pytest.mark.parametrize("place", ["file", "file/pack", "nowhere/pack", "link"])
def test_a_place_that_cannot_be_one_is_refused(tmp_path, place):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path)
    with pytest.raises(ConfigError):
        write_pack(tmp_path / place, FILES)


@pytest.mark.parametrize("call", range(4))
def test_a_disk_that_fails_leaves_nothing(tmp_path, monkeypatch, call):
    calls = []
    write_bytes = Path.write_bytes

    def fail(path, content):
        calls.append(path)
        if len(calls) == call + 1:
            raise OSError(28, "No space left on device", str(path))
        return write_bytes(path, content)

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(ConfigError, match="No space left"):
        write_pack(tmp_path / "pack", FILES)
    assert list(tmp_path.iterdir()) == []


def test_the_code_of_a_pack_is_its_files_with_their_names_and_without_caches(tmp_path, monkeypatch):
    config = hil_bench.load_config()
    monkeypatch.setattr(hil_bench, "__file__", str(tmp_path / "__init__.py"))
    for name, content in (("b/keys.tsv", b"{}"), ("a.py", b"{}"), ("b/__pycache__/c.pyc", b"")):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    lines = f"a.py\n{DIGEST}\nb/keys.tsv\n{DIGEST}\n"
    code = examine_software(config)["code"]
    assert code["hil_bench"] == hashlib.sha256(lines.encode()).hexdigest()


CHECKS = [{"verdict": "passed"}, {"verdict": "failed"}, {"verdict": "passed"}]
DEVICES = [
    {"verdict": "passed", "counts": {"passed": 3, "failed": 0, "not applicable": 0, "skipped": 0}},
    {"verdict": "failed", "counts": {"passed": 1, "failed": 2, "not exercised": 1}},
]
FOUND = [{"outcome": "passed"}, {"outcome": "inconclusive"}]


@pytest.mark.parametrize(
    ("plant", "devices", "digests", "traced", "lines"),
    [
        (
            CHECKS,
            DEVICES,
            ["0123456789abcdef", "f", "0123456789abcdef"],
            {"verdict": "inconclusive", "files": ["r"], "requirements": FOUND},
            [
                ("failed", "2 passed, 1 failed of 3 checks"),
                ("failed", "2 devices: 4 passed, 2 failed, 0 not applicable, 1 not exercised"),
                ("failed", "3 runs, 2 digests"),
                ("inconclusive", "1 passed, 1 inconclusive of 2 requirements"),
            ],
        ),
        (
            CHECKS[:1],
            DEVICES[:1],
            ["0123456789abcdef", "0123456789abcdef"],
            {"verdict": "not exercised", "files": ["r"], "requirements": []},
            [
                ("passed", "1 passed of 1 checks"),
                ("passed", "1 device: 3 passed, 0 failed, 0 not applicable"),
                ("passed", "2 runs, one digest, 0123456789ab"),
                ("not exercised", "no requirement in the results"),
            ],
        ),
    ],
)
def test_the_summary_counts_what_each_section_found(plant, devices, digests, traced, lines):
    runs = {"verdict": lines[2][0], "runs": [{"digest": digest} for digest in digests]}
    pack = {"plant": plant, "conformance": devices, "determinism": runs, "traceability": traced}
    assert [(line["verdict"], line["text"]) for line in summarise(pack)] == lines
