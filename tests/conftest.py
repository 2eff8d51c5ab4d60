"""How tests run: whatever time they take, since a loaded machine proves nothing."""

import gc
import importlib
import logging
import os
import sys
import tomllib

import lark.exceptions  # noqa: F401 - a run of pytester forgets what it imports, and we keep its parser
import pytest
from hypothesis import HealthCheck, settings
from support.distribution import PLUGIN, declare
from support.patience import LIMIT
from support.slow_tests import mark, pytest_runtest_protocol  # noqa: F401 - a hook

LEVEL = logging.root.level  # of pytest

settings.register_profile("unhurried", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("brief", settings.get_profile("unhurried"), max_examples=10)
settings.load_profile("unhurried")  # --hypothesis-profile=brief overrides it

gc.set_threshold(10_000)  # of a heap as large as ours the usual 700 take a twentieth of all time


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config):
    """End what hangs: here, as pytest refuses the ini key of a plugin that is not installed."""
    if config.pluginmanager.hasplugin("timeout") and config.option.timeout is None:
        config.option.timeout = LIMIT


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Let each worker begin with other files, so that none rewrites what another has rewritten.

    In a fresh checkout that takes longer than all else before the first test.
    """
    report = yield
    if isinstance(collector, pytest.Directory) and "PYTEST_XDIST_WORKER" in os.environ:
        worker = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
        first = len(report.result) * worker // int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        report.result = report.result[first:] + report.result[:first]
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Put the items back in order, which is the same for all workers, and mark the slow ones."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: item.path)
    mark(items)


@pytest.hookimpl
def pytest_collection_finish():
    """Set aside what stays to the end, all modules and tests: half a second a search of the heap.

    Each paced run begins with one.
    """
    _set_aside()


@pytest.fixture(scope="module", autouse=True)
def _modules_of_tests_before():
    """Set aside what the tests before have imported, as Numba."""
    if len(sys.modules) > _set_aside.modules + 20:
        _set_aside()


def _set_aside():
    gc.collect()
    gc.freeze()
    _set_aside.modules = len(sys.modules)


@pytest.fixture(scope="session", autouse=True)
def _own_options():
    """Give a pytest that a test starts, and a bench, their own options, not those of this one."""
    for name in ("PYTEST_ADDOPTS", "HIL_BENCH_CONFIG", "HIL_BENCH_SEED"):
        os.environ.pop(name, None)


@pytest.fixture(autouse=True)
def _own_log_handlers():
    """Take back the handlers that a test of the command line has put on the root logger.

    They would write to the captured stream of that test, which is closed by then; and --quiet lets
    the root logger drop warnings. The level is set before each test, too: a fixture of a module,
    which runs a verb before this one begins, leaves its own.
    """
    before = logging.root.handlers[:]
    logging.root.setLevel(LEVEL)
    yield
    logging.root.setLevel(LEVEL)
    logging.root.handlers[:] = [handler for handler in logging.root.handlers if handler in before]


@pytest.fixture(scope="session")
def anyio_backend():
    """The loop in which tests run that are coroutines, marked `anyio`."""
    return "asyncio"


@pytest.fixture
def cli(capsys, monkeypatch):
    """Calls a verb, sees that it ends with a code, and returns what it has said: `out`, `err`.

    Progress is not among that, however long a busy machine takes.
    """
    from hil_bench.cli import main  # noqa: PLC0415 - see `site`

    monkeypatch.setattr("hil_bench.abilities.common.progress.WORK_PERIOD", 10**18)

    def call(words, code=0):
        assert main(words.split() if isinstance(words, str) else words) == code
        return capsys.readouterr()

    return call


@pytest.fixture
def make_file(tmp_path):
    """Writes a file into a folder of the test's own, and returns its path."""

    def make(name, content):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return make


@pytest.fixture
def load_bench(tmp_path):
    """Loads a bench from the text of its file."""
    from hil_bench.bench.configuration import load_config  # noqa: PLC0415 - see `site`

    def load(text):
        path = tmp_path / "bench.toml"
        path.write_text(text, encoding="utf-8")
        return load_config(path)

    return load


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder in which distributions may be installed for one test."""
    # Not above: the tests of the CANopen device run where nothing else of the bench is.
    from hil_bench.devices.kinds.registry import KINDS  # noqa: PLC0415 - see above
    from hil_bench.plants.registry import PLANTS  # noqa: PLC0415

    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    for registry in (KINDS, PLANTS):
        monkeypatch.setattr(registry, "_loaded", {})
    yield folder
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", "")).startswith(str(folder)):
            del sys.modules[name]


@pytest.fixture
def spring_rig(site):
    """The package of examples/plugin, installed."""
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (site / "spring_rig").symlink_to(PLUGIN / "spring_rig")
    declare(site, project["name"], project["version"], project["entry-points"])
    importlib.invalidate_caches()


@pytest.fixture
def no_home(monkeypatch):
    """A user of a container, whom no list of users knows, without HOME."""
    monkeypatch.delenv("HOME", raising=False)

    def getpwuid(_uid):
        raise KeyError

    monkeypatch.setattr("pwd.getpwuid", getpwuid)
