"""Conformance of methods: one table of checks, run on every contestant, the project's own and anybody's."""
