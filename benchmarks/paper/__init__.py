"""The paper's experiment, repeated and judged: choices, contestants, errors, figures, tables and verdicts."""
