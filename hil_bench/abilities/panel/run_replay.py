"""A run of a campaign played again for a page: its verdicts, and the picture of the worst one."""

import base64
import json
import re
from pathlib import Path

from hil_bench.abilities.panel.own_program import run_words
from hil_bench.errors import ConfigError
from hil_bench.scratch import scratch_folder

_KEY = re.compile(r"[0-9a-f]{4,64}")
_OPTION = re.compile(r"--(runs|sampler|seed|set)=.+", re.DOTALL)
_PATIENCE = 120.0  # with a run [s]
_MOST_PICTURE = 1 << 24
_DECIDED = {0, 1, 6}  # exit codes of a run that came to an end


async def replay_run(again: object, key: str) -> dict[str, object]:
    """Play a run again in a process of its own.

    Args:
        again: words of the campaign's command, as the feed says them: checked here.
        key: of the run.

    Returns:
        The ``run`` as ``campaign --run --json`` has it, and the ``picture`` as a data URI; empty
        where there is none.

    Raises:
        ConfigError: the key or the words are wrong, or it cannot be played.
    """
    words = _checked(again)
    if not _KEY.fullmatch(key):
        raise ConfigError(f"run {key[:80]!a}: give the key of a run, hexadecimal digits")
    with scratch_folder() as folder:
        picture = folder / "run.svg"
        options = (f"--run={key}", f"--picture={picture}", "--json")
        code, output, errors = await _play([*words, *options])
        if code not in _DECIDED:
            text = errors[-_MOST_PICTURE:].decode(errors="replace").strip()
            raise ConfigError(text or f"run {key}: ended with exit code {code}")
        return {"run": json.loads(output)["run"], "picture": _data_uri(picture)}


def _checked(again: object) -> list[str]:
    """Return the words of a campaign's command.

    Raises:
        ConfigError: they are others; nothing else is ever started.
    """
    if (
        not isinstance(again, list)
        or len(again) < 2
        or not all(isinstance(word, str) for word in again)
        or again[0] != "campaign"
        or again[1].startswith("-")
        or not all(_OPTION.fullmatch(word) for word in again[2:])
    ):
        raise ConfigError("replay: what runs here is no campaign; repeat it in a shell")
    return again


async def _play(words: list[str]) -> tuple[int | None, bytes, bytes]:
    return await run_words(words, _PATIENCE, f"the run is not done after {_PATIENCE:g} s; ended")


def _data_uri(picture: Path) -> str:
    if not picture.exists() or picture.stat().st_size > _MOST_PICTURE:
        return ""
    return f"data:image/svg+xml;base64,{base64.b64encode(picture.read_bytes()).decode()}"
