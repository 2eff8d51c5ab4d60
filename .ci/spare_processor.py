"""Print which processor other work may keep busy beside User-Mode Linux, if there is one.

User-Mode Linux keeps to the first. Where a control group grants less than two processors' time,
whoever has used it up stands still for a tenth of a second, so there is none to spare.
"""

import os
from pathlib import Path

LIMIT = Path("/sys/fs/cgroup/cpu.max")  # of version 2: "MICROSECONDS PERIOD" or "max PERIOD"


def main() -> None:
    """Print it, or nothing."""
    processors = sorted(os.sched_getaffinity(0))
    granted, period = LIMIT.read_text().split() if LIMIT.exists() else ("max", "1")
    if len(processors) > 1 and (granted == "max" or int(granted) >= 2 * int(period)):
        print(processors[1])


if __name__ == "__main__":
    main()
