"""Every Python block of docs/python.md runs, in order."""

import re
from pathlib import Path

import pytest


def test_every_block_of_the_docs_runs(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("sklearn")
    monkeypatch.chdir(tmp_path)
    text = (root / "docs/python.md").read_text()
    blocks = [(m.start(), m.group(1)) for m in re.finditer(r"```python\n(.*?)```", text, re.DOTALL)]
    assert len(blocks) > 8
    names: dict[str, object] = {}
    for at, block in blocks:
        line = text.count("\n", 0, at) + 1
        exec(compile("\n" * line + block, root / "docs/python.md", "exec"), names)  # noqa: S102


def test_links_of_the_docs_lead_somewhere(root: Path):
    text = (root / "docs/python.md").read_text()
    for link in re.findall(r"\]\(([^)]+)\)", text):
        assert (root / "docs" / link).exists(), link
