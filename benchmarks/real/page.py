"""One self-contained page for all rigs, and the tables beside it. No outcome stands here or in the template."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

import jinja2

from benchmarks.real.outcome import Outcome, finite
from envs.log_files import write_atomically

TEMPLATE = Path(__file__).with_name("page.html.j2")


def render(outcomes: Sequence[Outcome]) -> str:
    """The page as HTML with its figures inside."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["cell"] = cell
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(outcomes=outcomes)


def cell(value: object, digits: int) -> str:
    """A table's cell: significant digits, powers of ten for the very large and small, true minus signs."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if isinstance(value, int):
        return str(value).replace("-", "−")
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        exponent = math.floor(math.log10(abs(value)))
        mantissa = f"{value / 10.0**exponent:.{max(digits - 1, 0)}f}"
        return f"{mantissa} × 10^{exponent}".replace("-", "−")
    places = max(0, digits - 1 - (math.floor(math.log10(abs(value))) if value else 0))
    return re.sub(r"-(?=\d)", "−", f"{value:.{places}f}")


def write(outcomes: Sequence[Outcome], out: Path) -> None:
    """``index.html``, ``results.json`` and ``tables/RIG_NAME.csv`` into a folder, whole or not at all."""
    numbers = {
        outcome.rig: {
            "title": outcome.title,
            "failure": outcome.failure,
            "summary": list(outcome.summary),
            "numbers": outcome.numbers,
            "tables": {
                table.name: {
                    "title": table.title,
                    "columns": list(table.columns),
                    "rows": [list(r) for r in table.rows],
                }
                for table in outcome.tables()
            },
            "seconds": outcome.seconds,
        }
        for outcome in outcomes
    }
    files = {
        out / "index.html": render(outcomes).encode(),
        out / "results.json": json.dumps(finite(numbers), ensure_ascii=False, indent=1).encode(),
    }
    for outcome in outcomes:
        for table in outcome.tables():
            files[out / "tables" / f"{outcome.rig}_{table.name}.csv"] = table.csv().encode()
    write_atomically(files)
