"""The command line of the project."""

from __future__ import annotations


def main() -> None:
    """Placeholder until the sub-commands are wired."""
    raise SystemExit("adeptone: no command yet")
