"""Warnings about implausible values of a bench, given once."""

import logging
from collections.abc import Sequence

logger = logging.getLogger(__name__)


def warn_of(doubts: Sequence[str]) -> None:
    """Say doubts on standard error, a line each; -q leaves them out."""
    for doubt in doubts:
        logger.warning("warning: %s", doubt)
