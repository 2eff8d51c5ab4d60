"""Reports: whole without a network, whatever a title or a firmware says."""

import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest
from support.campaigns import REST, write_rest

from hil_bench import cli

HOSTILE = "<script>alert(1)</script> & more"
CLOSE = REST.replace("value = 250.0, range = [1.0, 301.0]", "value = 60.0, range = [20.0, 80.0]")


class Page(HTMLParser):
    """What a page shows, and what it would load."""

    def __init__(self, text):
        super().__init__()
        self.words, self.loaded, self.tags = "", [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.loaded += [v for k, v in attrs if k in {"src", "href"} and not v.startswith("#")]

    def handle_data(self, data):
        self.words += f" {data} "


@pytest.mark.slow  # tens of runs of a scenario
@pytest.mark.parametrize("verb", ["campaign", "falsify"])
def test_a_report_is_whole_and_escapes_what_files_say(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = CLOSE.replace('"Rest"', f'"{HOSTILE}"').replace('"R-2"', f'"R-2 {HOSTILE}"')
    path = write_rest(tmp_path, text)
    words = [verb, str(path), "--runs=16", "--jobs=0", "--report=report.html"]
    if verb == "falsify":
        words.append("--method=random")
    assert cli.main(words) == 1
    html = (tmp_path / "report.html").read_text()
    page = Page(html)
    assert page.loaded == []
    assert "script" not in page.tags
    assert HOSTILE in page.words
    for part in html.split("<svg")[1:]:
        ET.fromstring("<svg" + part.partition("</svg>")[0] + "</svg>")  # noqa: S314 - our own
    assert html.count("<svg") >= 2


def test_the_report_says_which_parameter_matters_and_what_repeats_the_worst(tmp_path):
    path = write_rest(tmp_path, CLOSE)
    report = tmp_path / "report.html"
    cli.main(["campaign", str(path), "--runs=16", "--jobs=0", "--report", str(report)])
    words = " ".join(Page(report.read_text()).words.split())
    # The margin 1 - P_A / limit rises with the limit, and does not know the load.
    assert "rest R-1 limit_bar +1.00 16" in words
    assert words.count("rest: limit_bar=") == 10
    assert words.count("--set=limit_bar=") == 10


def test_a_report_that_cannot_be_written_is_said(tmp_path, capsys):
    path = write_rest(tmp_path)
    words = ["campaign", str(path), "--runs=1", "--jobs=0", "--report", str(tmp_path / "no" / "r")]
    assert cli.main(words) == 2
    assert "cannot be written: No such file or directory" in capsys.readouterr().err
