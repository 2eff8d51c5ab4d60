"""Print the commands of a job in a CI recipe: ``recipe.py FILE JOB``.

FILE is a GitHub Actions workflow or a GitLab CI configuration.
"""

import sys
from pathlib import Path

import yaml


def main() -> int:
    """Print the commands, one script."""
    file, job = sys.argv[1:]
    print("\n".join(commands(yaml.safe_load(Path(file).read_text(encoding="utf-8")), job)))
    return 0


def commands(recipe: dict, job: str) -> list[str]:
    """Return the commands of a job, one a line of its scripts."""
    if "jobs" in recipe:
        scripts = [step["run"] for step in recipe["jobs"][job]["steps"] if "run" in step]
    else:
        scripts = [*recipe[job].get("before_script", ()), *recipe[job]["script"]]
    return [line for script in scripts for line in script.splitlines()]


if __name__ == "__main__":
    sys.exit(main())
