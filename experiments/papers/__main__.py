"""All papers in one run: tables to the terminal, README.md and one SVG a paper beside this file, PNG into ``--out``.

python -m experiments.papers          # all
python -m experiments.papers 002      # one; the others' sections of README.md stay
python -m experiments.papers 002 --no-readme        # the tables and the PNG alone
"""

import argparse
import importlib
import time
from pathlib import Path

from experiments.papers import frame

HERE = Path(__file__).resolve().parent
NUMBERS = [path.stem.removeprefix("paper_") for path in sorted(HERE.glob("paper_[0-9][0-9][0-9].py"))]


def main() -> None:
    parser = argparse.ArgumentParser(description="reproduces the papers and writes experiments/papers/README.md")
    parser.add_argument("papers", nargs="*", metavar="PAPER", help=f"which: {', '.join(NUMBERS)}; all unless given")
    parser.add_argument("--out", type=Path, default=Path("out/papers"), help="folder of the figures (PNG)")
    parser.add_argument("--no-readme", action="store_true", help="leave README.md and its SVG as they are")
    given = parser.parse_args()
    unknown = sorted(set(given.papers) - set(NUMBERS))
    if unknown:
        parser.error(f"no such paper: {', '.join(unknown)} (there are {', '.join(NUMBERS)})")
    for number in given.papers or NUMBERS:
        begin = time.perf_counter()
        paper = importlib.import_module(f"experiments.papers.paper_{number}").results()
        print("\n".join(frame.lines(paper)))
        if not given.no_readme:
            # At once, so that a run that is stopped keeps what it has.
            frame.illustrate(paper, HERE)
            frame.write([paper], HERE)
        frame.save(paper, given.out)
        print(f"(paper_{number}: {time.perf_counter() - begin:.0f} s)\n", flush=True)


if __name__ == "__main__":
    main()
