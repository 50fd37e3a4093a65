"""What the README shows works as it stands there."""

import re
from pathlib import Path

import matplotlib as mpl
import pytest

README = Path(__file__).parent.parent / "README.md"


@pytest.mark.slow
def test_python_blocks_run():
    mpl.use("Agg")
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    assert len(blocks) >= 3
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(README), "exec"), names)
    assert names["tuned"].objective_on_finer_set < 0.00594 * 1.001
