"""All papers in one run: tables to the terminal, README.md and one SVG a paper beside this file, PNG into ``--out``.

python -m experiments.papers
"""

import argparse
import importlib
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
# The scripts run alone, too, and then find each other as plain modules; here they do so as well.
sys.path.insert(0, str(HERE))

import frame  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description="reproduces the papers and writes experiments/papers/README.md")
    parser.add_argument("--out", type=Path, default=Path("out/papers"), help="folder of the figures (PNG)")
    out = parser.parse_args().out
    papers = []
    for path in sorted(HERE.glob("paper_[0-9][0-9][0-9].py")):
        begin = time.perf_counter()
        papers.append(importlib.import_module(path.stem).results())
        print("\n".join(frame.lines(papers[-1])))
        frame.illustrate(papers[-1], HERE)
        frame.save(papers[-1], out)
        print(f"({path.stem}: {time.perf_counter() - begin:.0f} s)\n")
    frame.write(papers, HERE)


if __name__ == "__main__":
    main()
