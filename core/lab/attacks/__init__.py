"""Attacks on watermarked meshes, by thieves or careless tools; plain functions on plain geometry."""
