"""The stages of a fit: from rough and quick to fine."""

from typing import NamedTuple

LENGTH = 0.2
"""Length of the pieces of the finest stage [s]."""


class Stage(NamedTuple):
    """The fineness of the comparison between model and record.

    Attributes:
        name: for the progress bar.
        length: of the pieces [s].
        share: of the pieces that are used.
        blur: by which the noise is multiplied.
        rounds: at most.
        coarse: by which the solver's step is longer.
        precision: by which the steps for slopes are multiplied.
        enough: relative gain of a round below which the fit has converged.
        most: pieces at most; None for any number.
        near: cost a value below which the next stage, which converges faster, can take over.
        settlings: steps of the pieces' starts at most; more than one only near the optimum, since
            starts that fit a wrong model well hide how wrong it is.
    """

    name: str
    length: float
    share: float
    blur: float
    rounds: int
    coarse: int
    precision: float
    enough: float
    settlings: int
    most: int | None = None
    near: float = 0.0


ROUGH = Stage(
    "rough",
    length=0.04,
    share=0.25,
    blur=5.0,
    rounds=2,
    coarse=2,
    precision=1.0,
    enough=1e-3,
    settlings=1,
    most=128,
)
LONGER = ROUGH._replace(rounds=6)
"""Leads some records out of side minima that `ROUGH` ends in, and others into one."""

MIDDLE = Stage(
    "middle",
    length=0.15,
    share=0.4,
    blur=2.0,
    rounds=8,
    coarse=2,
    precision=0.3,
    enough=1e-3,
    settlings=1,
    near=0.16,  # 0.125 is noise alone
    most=48,
)
FINE = MIDDLE._replace(
    name="fine", length=LENGTH, share=1.0, blur=1.0, coarse=1, near=0.0, most=None
)
"""Its pieces are those of the last fit, which `hil_bench.abilities.identification.polish` makes."""

AGAIN = (
    MIDDLE._replace(
        name="again",
        length=0.08,
        share=1.0,
        blur=3.0,
        rounds=5,
        precision=1.0,
        most=None,
        near=0.0,
    ),
    FINE._replace(name="again", rounds=5, coarse=2, enough=1e-2),
)
"""What leads out of a side minimum: pieces too short for the motion to part, then with patience."""
