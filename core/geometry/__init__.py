"""Triangles, boxes, edges, rays and directions as arrays: no glTF, no policy. All else of the engine is above it."""
