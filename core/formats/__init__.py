"""All that is not a GLB: each format is recognised, checked and read into a glTF document."""
