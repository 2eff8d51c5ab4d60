"""Warnings about the EDS files of a bench, each file once."""

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.eds_document import EdsFinding, Severity
from hil_bench.config.settings import Settings
from hil_bench.errors import EdsError
from hil_bench.kinds.registry import KINDS

logger = logging.getLogger(__name__)

_OURS: Final = frozenset(kind.eds for kind in KINDS.built_in.values())
_MOST_SHOWN: Final = 10


def warn_of_nodes(nodes: Mapping[str, Settings]) -> None:
    """Log what is wrong in the EDS files of nodes, but for those of this package.

    A file that is no EDS is left to whoever makes the device.
    """
    for node in {node["eds"].value: node for node in nodes.values()}.values():
        path = Path(node["eds"].value)
        if path in _OURS:
            continue
        try:
            findings = load_eds(path, node["node_id"].value).findings
        except EdsError:
            continue
        warn_of_findings(path, findings)


def warn_of_findings(path: Path, findings: Iterable[EdsFinding]) -> None:
    """Log what is wrong in an EDS file, a line each, errors first, the first ten of many."""
    ordered = sorted(findings, key=lambda finding: finding.severity is not Severity.ERROR)
    for finding in ordered[:_MOST_SHOWN]:
        logger.warning("%s:%s", path, finding)
    if len(ordered) > _MOST_SHOWN:
        more = len(ordered) - _MOST_SHOWN
        logger.warning("%s: and %d more; hil-bench check-eds %s shows all", path, more, path)
