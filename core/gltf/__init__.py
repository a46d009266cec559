"""The glTF document: its container, accessors, scene, materials and textures, and the edit that embosses it."""
