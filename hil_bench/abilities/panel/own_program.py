"""This program again, in a process of its own, for what a page asks for."""

import asyncio
import sys
from collections.abc import Sequence

from hil_bench.errors import ControllerError


async def run_words(
    words: Sequence[str], patience: float, late: str
) -> tuple[int | None, bytes, bytes]:
    """Return exit code, output and errors of this program with some words.

    Args:
        words: of its command line.
        patience: longest time that it may take [s]; then it is ended.
        late: the message in that case.

    Raises:
        ControllerError: it takes too long.
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *("-m", "hil_bench", *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(patience):
            output, errors = await process.communicate()
    except TimeoutError:
        raise ControllerError(late) from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return process.returncode, output, errors
