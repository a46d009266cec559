"""Runs methods over meshes, counts and attacks, and writes the paper's tables and plots from what it finds."""
