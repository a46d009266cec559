"""``meshmark``: the engine on the command line."""

from core.cli.app import main

__all__ = ["main"]
