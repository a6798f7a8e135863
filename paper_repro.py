"""The paper from data to verdicts: `uv run paper_repro.py [--log FILE...] [--quick] [--out DIR]`.

Without logs the whole study runs on the simulated AdeptOne; with logs the same pipeline runs on measured data, the
first log being fitted and the others held out. Exit status: 0 done, 2 unusable input, in which case nothing is written.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread per process: same bits, and no quarrel between processes


def main(arguments: list[str] | None = None) -> int:
    """Runs the study or the pipeline on logs; returns the exit status."""
    parser = argparse.ArgumentParser(prog="paper_repro.py", description=(__doc__ or "").split("\n\n")[1])
    parser.add_argument("--log", nargs="+", type=Path, metavar="FILE", help="measured logs; the first one is fitted")
    parser.add_argument("--joint", type=int, help="joint of the logs, where they hold several")
    parser.add_argument("--quick", action="store_true", help="a small ensemble: looks the same, proves less")
    parser.add_argument("--out", type=Path, default=Path("results/paper"), help="folder to write (results/paper)")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    options = parser.parse_args(arguments)

    from benchmarks.paper.run import FULL, QUICK, InputError, run_on_logs, run_study

    try:
        if options.log:
            run_on_logs(options.log, options.joint, options.out, options.seed)
        else:
            run_study(QUICK if options.quick else FULL, options.out, options.seed)
    except InputError as error:
        print(f"paper_repro: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
