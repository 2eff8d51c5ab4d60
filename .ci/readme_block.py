"""Print the fenced block that follows ``<!-- NAME -->``: ``readme_block.py FILE NAME``."""

import re
import sys
from pathlib import Path


def main() -> int:
    """Return 0 once the block is printed, 1 where the file holds it not exactly once."""
    file, name = sys.argv[1:]
    pattern = rf"^<!-- {re.escape(name)} -->\n+```\w*\n(.*?)^```$"
    blocks = re.findall(pattern, Path(file).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    if len(blocks) != 1:
        print(f"{file}: {len(blocks)} blocks follow <!-- {name} -->, must be 1", file=sys.stderr)
        return 1
    print(blocks[0], end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
