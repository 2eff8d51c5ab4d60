"""How sure one can be after some runs: bounds on a probability."""

CONFIDENCE = 0.95


def failure_bound(failures: int, runs: int, confidence: float = CONFIDENCE) -> float:
    """Return the upper bound on a probability, one-sided (Clopper and Pearson, Biometrika 1934).

    It is exact for independent runs: with the true probability above it, as few failures come with
    a probability of at most 1 - `confidence`.

    Args:
        failures: how many runs failed.
        runs: how many there were.
        confidence: of the bound, from 0 to 1.
    """
    if failures >= runs:
        return 1.0
    if failures == 0:
        return float(1.0 - (1.0 - confidence) ** (1.0 / runs))
    from scipy.stats import beta  # noqa: PLC0415 - an extra, and slow to import

    return float(beta.ppf(confidence, failures + 1, runs - failures))


def say_bound(failures: int, runs: int) -> str:
    """Return the bound in words."""
    bound = failure_bound(failures, runs)
    return (
        f"{CONFIDENCE:.0%} upper bound on the failure probability under the sampled distribution "
        f"{bound:.2g}"
    )
