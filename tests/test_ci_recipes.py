"""What examples/ci tells users to run, run."""

import shutil
from xml.etree import ElementTree as ET

import pytest
import yaml
from support.ci_recipes import RECIPES, commands_of, run_commands


@pytest.mark.long
@pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")),
    reason="no C compiler; apt-get install make gcc libc6-dev",
)
def test_the_job_without_vcan_passes(tmp_path):
    done = run_commands(commands_of(RECIPES[0], "hub"), tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (suite,) = ET.parse(tmp_path / "artifacts" / "hub.xml").iter("testsuite")  # noqa: S314 - ours
    assert int(suite.get("tests")) > 10
    assert int(suite.get("skipped")) == 1  # what only real time can show


@pytest.mark.parametrize("job", ["hub", "vcan"])
def test_both_recipes_do_the_same(job):
    github, gitlab = (commands_of(recipe, job) for recipe in RECIPES)
    assert [line.removeprefix("sudo ") for line in github] == gitlab
    assert len(github) >= 2


def test_no_recipe_asks_an_index_for_the_bench():
    """No index has it: a requirement that begins with a path is a checkout or a wheel."""
    github, gitlab = (yaml.safe_load(path.read_text(encoding="utf-8")) for path in RECIPES)
    folder = RECIPES[0].parent
    action = yaml.safe_load((folder / "action" / "action.yml").read_text(encoding="utf-8"))
    (job,) = yaml.safe_load((folder / "gitlab-template.yml").read_text(encoding="utf-8")).values()
    for requirement in (
        github["env"]["HIL_BENCH"],
        gitlab["variables"]["HIL_BENCH"],
        action["inputs"]["wheel"]["default"],
        job["variables"]["HIL_BENCH_WHEEL"],
    ):
        assert requirement.startswith("./hil-bench")
