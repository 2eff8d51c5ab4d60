"""Frequency responses as a table."""

from collections.abc import Sequence

import numpy as np

from hil_bench.abilities.analysis.figures import ResponseCurve
from hil_bench.abilities.analysis.frequency_response import decibel
from hil_bench.abilities.analysis.study import make_table
from hil_bench.outside.recording.channels import Channel, Recording

VELOCITY_PER_OPENING = "(m/s)/m"
"""Unit of the gain from spool or orifice to piston velocity."""


def response_table(curves: Sequence[ResponseCurve]) -> Recording:
    """Return gain [dB], phase and coherence of curves that share their frequencies."""
    columns = {Channel("frequency", "Hz"): curves[0].frequencies}
    for curve in curves:
        label = curve.label.replace("$", "").replace("\\,", " ").replace("\\", "")
        columns[Channel(f"{label}: gain", "dB")] = decibel(curve.response)
        columns[Channel(f"{label}: phase", "deg")] = np.angle(curve.response, deg=True)
        if curve.coherence is not None:
            columns[Channel(f"{label}: coherence", "-")] = curve.coherence
    return make_table(columns)
