"""Logs of known cause, registered by name; each is described by the docstring that makes it."""

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from support.bus_logs import played

from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode, merge_nodes, nodes_of
from hil_bench.bench.configuration import load_config
from hil_bench.outside.recording.channels import LoggedFrame

Make = Callable[[], tuple[Iterable[LoggedFrame], list[KnownNode]]]
"""Gives the frames, and the nodes that ought to be there."""


@dataclass
class Case:
    """What is wrong in a log, and with which node; empty for the bus."""

    make: Make
    cause: Cause
    node: str


def bench_nodes(*others):
    """Return the nodes of the built-in bench, and others in their places."""
    return merge_nodes(nodes_of(load_config()), others)


def on_the_bench(play):
    """Return the frames of what `play` does to a rig on the built-in bench, and its nodes."""
    return played(play), bench_nodes()


class Broken(dict[str, Case]):
    """Logs with one thing wrong."""

    def of(self, cause, node=""):
        """Register what makes a log."""

        def register(make):
            self[make.__name__] = Case(make, cause, node)
            return make

        return register

    def played(self, cause, node="", on=on_the_bench):
        """Register what happens to a rig, whose log it makes."""

        def register(play):
            self[play.__name__] = Case(functools.partial(on, play), cause, node)
            return play

        return register


@functools.cache
def started():
    """Return a sound motion, which several logs begin with."""
    return tuple(played(lambda rig: rig.start()))
