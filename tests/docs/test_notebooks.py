"""The notebooks and the gallery show what their code gives, and a page can be taken apart and put together again."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from notebooks import NOTEBOOKS, as_ipynb, read_cells, run_page  # noqa: E402

PAGE = """# A page

```python
a = 2
print(a)
a
```

Prose.

```python
from pandas import DataFrame

DataFrame({"a": [a]})
```
"""


@pytest.mark.proof
def test_every_notebook_shows_what_its_code_gives():
    done = subprocess.run([sys.executable, DOCS / "notebooks.py", "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_code_shows_is_written_below_it_once(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    text, changed = run_page(page, tmp_path)
    assert len(changed) == 2
    page.write_text(text)
    assert run_page(page, tmp_path) == (text, [])
    assert "```text\n2\n```\n<!-- end -->" in text
    assert "<tr><th>0</th><td>2</td></tr>" in text
    page.write_text(text.replace("print(a)", "print('else')"))
    assert "shows something else" in run_page(page, tmp_path)[1][0]
    cells = json.loads(as_ipynb(page))["cells"]
    assert [one["cell_type"] for one in cells] == ["markdown", "code", "markdown", "code"]
    assert "<table" not in json.dumps(cells)


def test_gallery_has_every_picture_and_every_picture_its_file():
    import seatrial

    text = (NOTEBOOKS / "gallery.md").read_text()
    assert all(f"st.plot.{name}(" in text for name in seatrial.plot.__all__)
    for page in NOTEBOOKS.glob("*.md"):
        for cell in read_cells(page):
            pictures = [line[4:-1] for line in cell.shown if line.startswith("![](")]
            assert all((NOTEBOOKS / name).stat().st_size < 100_000 for name in pictures)
