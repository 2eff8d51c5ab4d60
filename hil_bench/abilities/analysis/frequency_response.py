"""Frequency responses measured from simulation: a chirp, and the H1 estimate with its coherence.

Ruderman 2017, section IV-B and fig. 5: a down-chirp from 600 to 1 Hz on the spool set-point, H1 to
the piston velocity, input nonlinearities left out.
"""

import math
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.simulation import Setup, Signal, simulate
from hil_bench.abilities.analysis.steady_motion import NyquistError
from hil_bench.errors import ParameterError, require_extra
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive

SMOOTHING = 1.0 / 48.0
"""Width of the spectra's moving average [octave].

A twelfth of an octave would turn the phase of a resonance of 0.11 damping by 1.4 degrees; the error
grows with the square of the width.
"""

_LONGEST = 20_000_000  # samples: a gigabyte


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirp:
    """A sine whose frequency moves linearly from start to end.

    Attributes:
        amplitude: in the unit of the signal.
        start_frequency: [Hz].
        end_frequency: [Hz]; below the start for a down-chirp.
        duration: [s].

    Raises:
        ParameterError: a value is not positive.
    """

    amplitude: float
    start_frequency: float = 600.0
    end_frequency: float = 1.0
    duration: float = 60.0

    def __post_init__(self) -> None:
        require_positive("amplitude", self.amplitude, "")
        require_positive("start_frequency", self.start_frequency, "Hz")
        require_positive("end_frequency", self.end_frequency, "Hz")
        require_positive("duration", self.duration, "s")

    def samples(self, dt: float) -> Signal:
        """Return the chirp, sampled each `dt` seconds.

        Raises:
            NyquistError: it reaches half of the sampling frequency.
            ParameterError: it has more samples than memory should hold, or none.
        """
        nyquist = 0.5 / dt
        highest = max(self.start_frequency, self.end_frequency)
        if highest >= nyquist:
            raise NyquistError(
                f"chirp up to {highest:g} Hz: must stay below the Nyquist frequency of "
                f"{nyquist:g} Hz, half of one sample each {dt:g} s"
            )
        count = round(self.duration / dt)
        if not 2 <= count <= _LONGEST:
            raise ParameterError(
                f"chirp of {self.duration:g} s: {count} samples of {dt:g} s; "
                f"2 to {_LONGEST} are right"
            )
        time = np.arange(count) * dt
        sweep = (self.end_frequency - self.start_frequency) / self.duration
        turns = self.start_frequency * time + 0.5 * sweep * time**2
        return np.asarray(self.amplitude * np.sin(2.0 * math.pi * turns))

    def time_of(self, frequency: float) -> float:
        """Return when the chirp passes a frequency [s]."""
        span = self.end_frequency - self.start_frequency
        return self.duration * (frequency - self.start_frequency) / span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseEstimate:
    """A measured frequency response.

    Attributes:
        frequency: [Hz], shape (n,).
        response: H1, in the unit of output / input, complex, shape (n,).
        coherence: 0 to 1, shape (n,): how much of the output follows the input linearly.
    """

    frequency: npt.NDArray[np.float64]
    response: npt.NDArray[np.complex128]
    coherence: npt.NDArray[np.float64]

    def gain_at(self, frequency: float) -> float:
        """Return the gain at a frequency, from the nearest lines [dB of output / input]."""
        return float(np.interp(frequency, self.frequency, self.gain))

    @property
    def gain(self) -> npt.NDArray[np.float64]:
        """The gain [dB of output / input]."""
        return decibel(self.response)

    def peak(self, low: float, high: float) -> tuple[float, float]:
        """Return frequency [Hz] and gain [dB] of the largest gain between two frequencies [Hz].

        Raises:
            ParameterError: the estimate has no line there.
        """
        inside = np.flatnonzero((self.frequency >= low) & (self.frequency <= high))
        if not inside.size:
            raise ParameterError(f"no line of the estimate lies between {low:g} and {high:g} Hz")
        best = inside[int(np.argmax(self.gain[inside]))]
        return float(self.frequency[best]), float(self.gain[best])


def decibel(response: npt.NDArray[np.complex128]) -> npt.NDArray[np.float64]:
    """Return 20 log10 |response| [dB], minus infinity where nothing responds."""
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(np.abs(response)), dtype=np.float64)


def estimate_response(
    excitation: Signal,
    response: Signal,
    dt: float,
    *,
    resolution: float = 0.25,
    smoothing: float = 0.0,
    is_held: bool = False,
) -> ResponseEstimate:
    """Return H1 = S_uy / S_uu and the coherence |S_uy|² / (S_uu S_yy).

    Spectra by Welch's method: Hann windows that share three quarters of their length, the mean of
    each removed. The squares of such windows add up to a constant, so that a chirp weighs the same
    when it reaches the input and, later, the output. Noise in the response averages out of H1;
    noise in the excitation does not.

    Args:
        excitation: u, shape (samples,).
        response: y, shape (samples,).
        dt: from sample to sample [s].
        resolution: distance of the frequency lines [Hz]; a window is as long as its inverse.
        smoothing: width of a moving average over the spectra [octave]; 0 turns it off.
        is_held: whether each sample of the excitation was held over the step that ends with the
            response's sample, as `simulate` pairs them. The plant then sees a staircase, which is
            sinc(f dt) times as large as its samples and half a step ahead of them; the response is
            corrected for both.

    Raises:
        ParameterError: the signals differ in length, hold no full window or are not finite.
    """
    require_extra("scipy", "a frequency response")
    from scipy import signal  # noqa: PLC0415 - an extra, and slow to import

    window = round(1.0 / (resolution * dt))
    shared = window * 3 // 4
    if excitation.shape != response.shape or not 8 <= window <= len(excitation):
        raise ParameterError(
            f"frequency response: {len(excitation)} samples of the excitation and {len(response)} "
            f"of the response; both need the same number, and at least the {window} of one window"
        )
    if not (np.isfinite(excitation).all() and np.isfinite(response).all()):
        raise ParameterError("frequency response: every sample must be finite")
    pairs = ((excitation, response), (excitation, excitation), (response, response))
    cross, of_input, of_output = (
        _smoothed(
            signal.csd(first, second, 1.0 / dt, nperseg=window, noverlap=shared)[1], smoothing
        )
        for first, second in pairs
    )
    power = of_input.real * of_output.real
    coherent = np.abs(cross) ** 2
    frequency = np.asarray(np.fft.rfftfreq(window, dt), dtype=np.float64)
    if is_held:
        cross = cross * np.exp(-1j * np.pi * frequency * dt) / np.sinc(frequency * dt)
    with np.errstate(divide="ignore", invalid="ignore"):  # a line without excitation has no answer
        return ResponseEstimate(
            frequency=frequency,
            response=cross / of_input.real,
            coherence=np.where(power > 0.0, coherent / power, 0.0),
        )


def _smoothed(spectrum: npt.NDArray[np.complex128], width: float) -> npt.NDArray[np.complex128]:
    """Return each line as the mean over `width` octaves around it, with as many on either side."""
    if width <= 0.0:
        return spectrum
    numbers = np.arange(len(spectrum))
    reach = 2.0 ** (0.5 * width)
    half = np.floor(0.5 * numbers * (reach - 1.0 / reach)).astype(int)
    half = np.minimum(half, len(spectrum) - 1 - numbers)
    low, high = numbers - half, numbers + half
    sums = np.concatenate(([0.0], np.cumsum(spectrum)))
    return np.asarray((sums[high + 1] - sums[low]) / (high + 1 - low), dtype=np.complex128)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChirpRun:
    """A chirp on the spool set-point, and what came of it.

    Attributes:
        setup: what was simulated.
        chirp: the set-point [m].
        recording: the run, a row a step.
        estimate: of the response from set-point [m] to velocity [m/s], in the chirp's range.
    """

    setup: Setup
    chirp: Chirp
    recording: Recording
    estimate: ResponseEstimate


def measure_frequency_response(
    setup: Setup, chirp: Chirp, *, smoothing: float = SMOOTHING
) -> ChirpRun:
    """Return the response from spool set-point to velocity, measured with a chirp.

    The input nonlinearities of eq. (2) are in; `without_input_nonlinearities` leaves them out.

    Args:
        setup: what is simulated.
        chirp: the set-point [m].
        smoothing: width of the moving average over the spectra [octave].
    """
    recording = simulate(setup, chirp.samples(setup.dt))
    estimate = estimate_response(
        recording["u"], recording["v"], setup.dt, smoothing=smoothing, is_held=True
    )
    ends = sorted((chirp.start_frequency, chirp.end_frequency))
    inside = (estimate.frequency >= ends[0]) & (estimate.frequency <= ends[1])
    estimate = ResponseEstimate(
        frequency=estimate.frequency[inside],
        response=estimate.response[inside],
        coherence=estimate.coherence[inside],
    )
    return ChirpRun(setup=setup, chirp=chirp, recording=recording, estimate=estimate)


# Root locus.

Polynomial = npt.NDArray[np.float64]
"""Coefficients, the highest power first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RootLocus:
    """The closed loop's poles over the feedback gain.

    Attributes:
        gains: k [m²/s], shape (n,), rising from 0.
        poles: of the closed loop [rad/s], shape (n, order); a column follows one branch.
        open_loop_poles: where the branches start [rad/s].
        critical_gain: k at which the closed loop becomes unstable [m²/s].
        critical_frequency: of the oscillation there [rad/s].
    """

    gains: npt.NDArray[np.float64]
    poles: npt.NDArray[np.complex128]
    open_loop_poles: npt.NDArray[np.complex128]
    critical_gain: float
    critical_frequency: float


def root_locus(
    parameters: PlantParameters, *, gains: npt.ArrayLike | None = None, with_spool: bool = False
) -> RootLocus:
    """Return the poles of 1 + k G(s) / s = 0 with G(s) of eq. (18), and the critical gain.

    Args:
        parameters: of the plant.
        gains: k [m²/s]; None for 0 to three times the critical gain.
        with_spool: whether the spool of eq. (1) stands in the loop too.

    Raises:
        ParameterError: a gain is negative or not finite, or they do not rise.
    """
    denominator = _open_loop(parameters, with_spool=with_spool)
    critical_gain, critical_frequency = _stability_limit(denominator)
    chosen = _spread(critical_gain) if gains is None else np.asarray(gains, dtype=np.float64)
    if chosen.ndim != 1 or not (np.isfinite(chosen).all() and (chosen >= 0.0).all()):
        raise ParameterError("gains: must be finite and 0 or greater, in a row")
    if (np.diff(chosen) <= 0.0).any():
        raise ParameterError("gains: must rise, so that each branch can be followed")
    return RootLocus(
        gains=chosen,
        poles=_branches(denominator, chosen),
        open_loop_poles=np.roots(denominator).astype(np.complex128),
        critical_gain=critical_gain,
        critical_frequency=critical_frequency,
    )


def _open_loop(parameters: PlantParameters, *, with_spool: bool) -> Polynomial:
    """Return the denominator of G(s) / s over a numerator of 1."""
    omega, omega_0 = parameters.omega_c, parameters.omega_0
    cylinder = np.array([1.0 / omega**2, 2.0 * parameters.zeta / omega, 1.0, 0.0])
    denominator: Polynomial = parameters.mean_area * cylinder
    if with_spool:
        spool = [1.0 / omega_0**2, 2.0 * parameters.xi / omega_0, 1.0]
        denominator = np.asarray(np.polymul(denominator, spool), dtype=np.float64)
    return denominator


def _stability_limit(denominator: Polynomial) -> tuple[float, float]:
    """Return the smallest positive gain with a pole on the imaginary axis, and where it lies.

    At s = j w, D(s) + k = 0 splits into its even powers of s, a polynomial in w² that gives -k,
    and its odd ones, which must vanish on their own.
    """
    order = len(denominator) - 1
    signs = np.array([1.0, 1.0, -1.0, -1.0])[np.arange(order, -1, -1) % 4]
    signed = denominator * signs
    odd = signed[(order - 1) % 2 :: 2]
    even = signed[order % 2 :: 2]
    crossings = []
    for square in np.roots(odd):
        gain = -float(np.polyval(even, square.real))
        if abs(square.imag) < 1e-9 * abs(square) and square.real > 0.0 and gain > 0.0:
            crossings.append((gain, math.sqrt(square.real)))
    return min(crossings, default=(math.inf, math.nan))


def _spread(critical_gain: float) -> npt.NDArray[np.float64]:
    """Return gains with more of them where the branches leave the open loop's poles."""
    largest = 3.0 * critical_gain if math.isfinite(critical_gain) else 1.0
    gains: npt.NDArray[np.float64] = largest * np.linspace(0.0, 1.0, 601) ** 2
    return gains


def _branches(
    denominator: Polynomial, gains: npt.NDArray[np.float64]
) -> npt.NDArray[np.complex128]:
    """Return the roots for each gain, each column next to where it was at the gain before."""
    constant = np.zeros_like(denominator)
    constant[-1] = 1.0
    orders = np.array(list(permutations(range(len(denominator) - 1))))
    rows: list[npt.NDArray[np.complex128]] = []
    for gain in gains:
        roots = np.roots(denominator + gain * constant).astype(np.complex128)
        before = rows[-1] if rows else np.sort_complex(roots)
        nearest = np.abs(roots[orders] - before).sum(axis=1).argmin()
        rows.append(roots[orders[nearest]])
    return np.array(rows)
