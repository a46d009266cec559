"""Artwork to emboss: fonts, the shaping of text, and its glyphs as closed, disjoint outlines."""
