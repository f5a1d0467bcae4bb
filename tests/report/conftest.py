"""Makes the shared builders of `tests/support` importable; pages that several files look at, rendered once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from small_results import Words, small_results

from sysid.report import render_report

#: Everything at once that breaks out of text, attributes, style sheets, scripts, comments or templates.
HOSTILE = (
    '"\' onmouseover=pwned() x="><pwned></style></script></svg></title><script>pwned()</script>'
    "<img src=x onerror=pwned>{{7*7}}{% raw %}<!-- ]]> &lt;pwned&gt; $\\frac{1}$ \u202e\x00\U0001f69a javascript:pwned"
)


@pytest.fixture(scope="session")
def full_text():
    return render_report(small_results())


@pytest.fixture(scope="session")
def hostile_text():
    return render_report(small_results(Words.all(HOSTILE)))
