"""Extensions by other distributions: kinds of devices and of plants, and abilities."""

from typing import cast

from hil_bench.abilities.doctor.finding import Finding, Topic, Verdict, absent, good
from hil_bench.ability import abilities, load, own_abilities
from hil_bench.kinds.registry import KINDS
from hil_bench.plants.registry import PLANTS
from hil_bench.registry import Extension, Registry


def examine_extensions() -> Topic:
    """The kinds and abilities that are installed besides the bench's own; each is imported."""
    findings = [_kind("kind of device", extension) for extension in KINDS.extensions()]
    findings += [_kind("kind of plant", extension) for extension in PLANTS.extensions()]
    for ability in own_abilities():
        for what, place in ability.registries.items():
            registry = cast("Registry[object]", load(place))
            findings += [_kind(what, extension) for extension in registry.extensions()]
    findings += [_kind("ability", extension) for extension in abilities().extensions()]
    return Topic("Extensions", tuple(findings or [absent("kinds", "none installed")]))


def _kind(what: str, extension: Extension) -> Finding:
    value = f"{what}, {extension.distribution}"
    if extension.problem:
        return Finding(extension.name, Verdict.MISSING, f"{value}, not loaded", extension.problem)
    return good(extension.name, value)
