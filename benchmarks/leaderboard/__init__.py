"""The benchmark's report: standings from rows, tables in four formats, one interactive page."""
