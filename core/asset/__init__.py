"""Bytes <-> a welded working surface: intake limits, formats, lossless GLB editing."""
