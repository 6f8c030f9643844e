"""Every Python block of docs/python.md runs, in order."""

import json
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


def test_the_notebook_runs_from_the_start_to_its_report(
    root: Path, small: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its cells as they stand, but for the settings."""
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((root / "python/examples/stepping.ipynb").read_text())
    names: dict[str, object] = {}
    for i, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] == "code":
            source = "".join(cell["source"]).replace("SETTINGS = {}", f"SETTINGS = {small!r}")
            exec(compile(source, f"stepping.ipynb, cell {i}", "exec"), names)  # noqa: S102
    assert (tmp_path / "runs/notebook/report.html").exists()
