"""Marks and labels read back from a suspect file."""
