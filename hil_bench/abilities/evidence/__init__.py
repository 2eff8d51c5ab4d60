"""The proof that this installation does what it promises, as a folder."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "evidence",
    needs=("analysis", "conformance", "doctor"),
    verbs={
        "evidence": Verb(
            "test",
            60,
            "validate this installation, and write the evidence as a folder",
            "hil_bench.abilities.evidence.verbs",
        ),
    },
)
