"""One self-contained page that reads like a short paper: text, figures, tables, everything inside one file.

No outcome stands in the template or here: sentences with numbers are built from the results.
"""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from pathlib import Path

import jinja2

from benchmarks.paper.tables import Table, text_of

TEMPLATES = Path(__file__).parent


@dataclass(frozen=True)
class Picture:
    """A figure on the page: file name without suffix, caption."""

    name: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, figures and tables in this order; folded tables open on a click."""

    heading: str
    paragraphs: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    folded: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Page:
    """Title, abstract, verdicts as (number, claim, criterion, figures, verdict), sections."""

    title: str
    abstract: tuple[str, ...]
    verdicts: Table | None
    sections: tuple[Section, ...]


def render(page: Page, figures: Path) -> str:
    """The page as HTML; figures are read from a folder and put inside."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    environment.filters["cell"] = _cell
    environment.filters["tone"] = _tone
    inside = {
        picture.name: base64.b64encode((figures / f"{picture.name}.svg").read_bytes()).decode()
        for section in page.sections
        for picture in section.pictures
    }
    return environment.get_template("page.html.j2").render(page=page, inside=inside)


def _cell(value: object, digits: int) -> str:
    """A cell with true minus signs, at which no browser breaks a number in two."""
    return re.sub(r"-(?=\d)", "−", text_of(value, digits))


def _tone(verdict: str) -> str:
    """Style class of a verdict."""
    if verdict == "reproduced":
        return "yes"
    return "no" if verdict == "not reproduced" else "partly"
