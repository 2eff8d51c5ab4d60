"""A parser that takes its positional arguments wherever they stand."""

import argparse
from collections.abc import Sequence


class Parser(argparse.ArgumentParser):
    """Leaves an optional positional for the arguments that stand behind an option.

    In ``FILE --virtual bench.toml`` Python before 3.12.7 has bench.toml's place empty as soon as it
    has seen FILE, and refuses bench.toml then.
    """

    def _match_arguments_partial(
        self, actions: Sequence[argparse.Action], arg_strings_pattern: str
    ) -> list[int]:
        counts = super()._match_arguments_partial(actions, arg_strings_pattern)
        has_more = "A" in arg_strings_pattern[sum(counts) :]  # "A" for argument, "O" for option
        while has_more and counts and counts[-1] == 0:
            counts.pop()
        return counts
