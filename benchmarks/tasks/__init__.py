"""What contestants are asked. One file per family of tasks; see `benchmarks.tasks.base`."""
