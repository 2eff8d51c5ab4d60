"""What an integer object shows for a quantity that it cannot hold."""


def saturate(value: float, lowest: int, highest: int, *, unknown: int) -> int:
    """Return `value` as the nearest integer from `lowest` to `highest`, or `unknown` for NaN."""
    if value <= lowest:
        return lowest
    if value >= highest:
        return highest
    return round(value) if value == value else unknown  # noqa: PLR0124 - false for NaN only
