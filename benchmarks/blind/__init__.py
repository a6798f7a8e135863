"""Blind trials in a world of their own: its simulator shares no physics with the models judged on its logs."""
