"""The robot and its measured world."""

from envs.registration import register

register()
