"""All formats but GLB: each is recognised, checked and read into a glTF document."""
