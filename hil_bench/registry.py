"""Names to objects: those of the bench itself, and those that other distributions bring.

Another distribution declares an object as an entry point of a group. It is looked for only when a
name is asked for that the bench itself does not have, and imported only when it is that name.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from traceback import walk_tb
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


class Extension(NamedTuple):
    """An object that another distribution declares.

    Attributes:
        name: under which it is asked for.
        distribution: its name and version, as in "joystick 1.0".
        problem: why it cannot be had; empty where it can.
    """

    name: str
    distribution: str
    problem: str


class Registry(Generic[T]):
    """The objects of one kind by their names.

    Args:
        group: of the entry points.
        kind: of which each object must be.
        built_in: those of the bench itself.
        find_fault: returns what is wrong with an object from elsewhere; empty where nothing is.
    """

    def __init__(
        self,
        group: str,
        kind: type[T],
        built_in: Mapping[str, T],
        find_fault: Callable[[T], str],
    ) -> None:
        self.group = group
        self.built_in = built_in
        self._kind = kind
        self._find_fault = find_fault
        self._loaded: dict[str, T] = {}

    def names(self) -> list[str]:
        """Return all names, those of the bench itself first; nothing is imported."""
        others = (point.name for point in self._points())
        return list(dict.fromkeys((*self.built_in, *others)))

    def find(self, name: str) -> T | None:
        """Return the object of a name; None where there is none.

        Raises:
            ConfigError: a distribution declares it, but does not have it; one line says which.
        """
        found = self.built_in.get(name) or self._loaded.get(name)
        if found is not None:
            return found
        points = [point for point in self._points() if point.name == name]
        if not points:
            return None
        if problem := self._clash(points):
            raise ConfigError(problem)
        self._loaded[name] = self._load(points[0])
        return self._loaded[name]

    def extensions(self) -> Iterator[Extension]:
        """Yield what other distributions declare, each tried."""
        points = self._points()
        for point in points:
            same = [other for other in points if other.name == point.name]
            problem = self._clash(same)
            if not problem and point.name not in self._loaded:
                try:
                    self._loaded[point.name] = self._load(point)
                except ConfigError as error:
                    problem = str(error)
            yield Extension(point.name, _distribution(point), problem)

    def _points(self) -> "Sequence[EntryPoint]":
        from importlib.metadata import entry_points  # noqa: PLC0415 - slow, and seldom needed

        return sorted(entry_points(group=self.group), key=lambda point: (point.name, point.value))

    def _clash(self, points: "Sequence[EntryPoint]") -> str:
        """Return the fault of entry points of one name; empty for a single one of a free name."""
        name = points[0].name
        owners = ", ".join(sorted({_distribution(point) for point in points}))
        if name in self.built_in:
            return f'{owners}: {self.group}: "{name}" is hil-bench\'s own; it needs another name'
        if len(points) > 1:
            right = "uninstall one, or give it another name"
            return f'{owners}: {self.group}: "{name}" is declared {len(points)} times; {right}'
        return ""

    def _load(self, point: "EntryPoint") -> T:
        """Return the object behind an entry point.

        Raises:
            ConfigError: it cannot be imported, or is something else.
        """
        place = f'{_distribution(point)}: {self.group}: "{point.name}" ({point.value})'
        try:
            found = point.load()
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ConfigError(f"{place} cannot be imported: {reason}") from error
        if not isinstance(found, self._kind):
            wrong = f"is {type(found).__name__}"
            raise ConfigError(f"{place} {wrong}; an instance of {self._kind.__name__} is right")
        if (own := getattr(found, "name", None)) != point.name:
            raise ConfigError(f"{place} calls itself {own!r}; both names must be the same")
        if fault := self._find_fault(found):
            raise ConfigError(f"{place} {fault}")
        return found


def owner_of(error: BaseException) -> str:
    """Return the distribution in whose code an error arose; empty where that extends no bench."""
    from importlib.metadata import distributions  # noqa: PLC0415 - slow, and seldom needed

    owners = {
        point.module.partition(".")[0]: _distribution(point)
        for each in distributions()
        for point in each.entry_points
        if point.group.startswith("hil_bench.")
    }
    modules = [frame.f_globals.get("__name__", "") for frame, _ in walk_tb(error.__traceback__)]
    packages = [name.partition(".")[0] for name in reversed(modules)]
    return next((owners[name] for name in packages if name in owners), "")


def find_twice(names: Iterable[str]) -> str | None:
    """Return the first name that is there twice, None where each is there once."""
    counts = Counter(names)
    return next((name for name, count in counts.items() if count > 1), None)


def _distribution(point: "EntryPoint") -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown distribution"
