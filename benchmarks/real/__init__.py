"""Real machines: what their nominal models miss, in names and numbers, on recordings that others made."""
