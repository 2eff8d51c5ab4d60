"""State trajectories under a sinusoidal set-point (Ruderman 2017, section IV-C and fig. 6)."""

import math

import numpy as np

from hil_bench.abilities.analysis.errors import NyquistError
from hil_bench.abilities.analysis.simulation import Setup, simulate
from hil_bench.errors import ParameterError
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive

_LONGEST = 20_000_000  # steps: a gigabyte


def state_trajectory(
    setup: Setup,
    *,
    amplitude: float,
    frequency: float = 0.1,
    duration: float = 10.0,
    every: int = 5,
) -> Recording:
    """Return a run under u = amplitude sin(2 pi frequency t).

    Args:
        setup: what is simulated.
        amplitude: of the spool set-point [m].
        frequency: of the spool set-point [Hz].
        duration: [s].
        every: how many steps lie between two rows.

    Raises:
        NyquistError: the frequency reaches half of the solver's sampling frequency.
        ParameterError: a value is not positive, or there are more steps than memory should hold.
    """
    require_positive("amplitude", amplitude, "m")
    require_positive("frequency", frequency, "Hz")
    require_positive("duration", duration, "s")
    if frequency >= 0.5 / setup.dt:
        raise NyquistError(
            f"sine of {frequency:g} Hz: must stay below the Nyquist frequency of "
            f"{0.5 / setup.dt:g} Hz, half of one sample each {setup.dt:g} s"
        )
    steps = round(duration / setup.dt)
    if not 1 <= steps <= _LONGEST:
        raise ParameterError(
            f"duration = {duration:g} s: {steps} steps of {setup.dt:g} s; 1 to {_LONGEST} are right"
        )
    time = np.arange(steps) * setup.dt
    return simulate(setup, amplitude * np.sin(2.0 * math.pi * frequency * time), every=every)
