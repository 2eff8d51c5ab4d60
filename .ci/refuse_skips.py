"""Fail unless a JUnit report tells of tests that all ran and passed: ``refuse_skips.py REPORT``."""

import sys
from xml.etree import ElementTree as ET


def main() -> int:
    """Return 0 where every test of the report ran and passed, 1 otherwise."""
    report = ET.parse(sys.argv[1])  # noqa: S314 - our own pytest wrote it
    suites = list(report.getroot().iter("testsuite"))
    names = ("tests", "skipped", "failures", "errors")
    counts = {name: sum(int(suite.get(name, "0")) for suite in suites) for name in names}
    print(", ".join(f"{name}: {count}" for name, count in counts.items()))
    if counts["tests"] > 0 and not (counts["skipped"] or counts["failures"] or counts["errors"]):
        return 0
    print(f"{sys.argv[1]}: some test must run, and all must pass here", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
