"""The guide to Python is true: every block of it runs, in order, and gives the results that it shows."""

from __future__ import annotations

import doctest
import re
import shutil
from pathlib import Path

import pytest

from conftest import REPOSITORY

GUIDE = REPOSITORY / "docs/guide/python.md"
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.timeout(1800)  # two minutes on an idle machine
def test_the_guide_to_python(tmp_path: Path, sample_survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("geopandas")
    monkeypatch.chdir(tmp_path)
    shutil.copytree(sample_survey, "my-row")  # what the guide's first lines make: they find it finished
    page = GUIDE.read_text(encoding="utf-8")
    names: dict[str, object] = {}
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE, verbose=False)
    said: list[str] = []
    examples = 0
    for block in BLOCK.finditer(page):
        line = page[: block.start(1)].count("\n")
        test = doctest.DocTestParser().get_doctest(block[1], names, GUIDE.name, str(GUIDE), line)
        assert test.examples, f"{GUIDE.name}, line {line + 1}: a block without `>>>`"
        runner.run(test, out=said.append, clear_globs=False)
        names.update(test.globs)  # each block has a copy of the names; the next one goes on with them
        examples += len(test.examples)
    assert examples > 50
    assert runner.failures == 0, "".join(said)
