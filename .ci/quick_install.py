"""Install into an environment as pip does, but quicker: ``quick_install.py PYTHON ARGUMENT ...``.

uv does it where it can, in a fifth of pip's processor time, from the indexes that pip is set up
with. Where uv is missing or fails, pip does it, and says what is wrong. What README or a recipe
tells users is not for this program: those run as printed.
"""

import os
import subprocess
import sys

UV_NAMES = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_EXTRA_INDEX_URL",
    "find-links": "UV_FIND_LINKS",
    "constraint": "UV_CONSTRAINT",
    "cert": "SSL_CERT_FILE",
}
"""The names of uv for settings of pip."""
WEAKEST_FIRST = ("global", "user", "site", ":env:")


def settings_of_pip() -> dict[str, str]:
    """Return pip's own settings, by their names without the place that they come from."""
    command = [sys.executable, "-m", "pip", "config", "list"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603 - pip
    found = {}
    for line in listed.splitlines():
        place, _, setting = line.partition(".")
        name, _, value = setting.partition("=")
        found[place, name] = value.strip("'\"").replace("\\n", " ").strip()
    return {name: found[at, name] for at in WEAKEST_FIRST for place, name in found if place == at}


def by_uv(python: str, arguments: list[str]) -> bool:
    """Install with uv; return False where that failed."""
    settings = settings_of_pip()
    environment = os.environ | {
        uv: settings[pip].replace(" ", ",") if pip == "find-links" else settings[pip]
        for pip, uv in UV_NAMES.items()
        if pip in settings
    }
    environment.setdefault(
        "UV_INDEX_STRATEGY", "unsafe-best-match"
    )  # all indexes are one, as for pip
    command = [sys.executable, "-m", "uv", "pip", "install", "-q", "--python", python]
    done = subprocess.run(  # noqa: S603 - uv
        [*command, *arguments], env=environment, capture_output=True, check=False
    )
    return done.returncode == 0


def main() -> int:
    """Return the exit code of the installer that had the last word."""
    python, *arguments = sys.argv[1:]
    if by_uv(python, arguments):
        return 0
    print("uv did not install it, so pip does", flush=True)
    command = [python, "-m", "pip", "install", "-q", *arguments]
    return subprocess.run(command, check=False).returncode  # noqa: S603 - pip


if __name__ == "__main__":
    sys.exit(main())
