"""Renderings of a GLB as an ordinary glTF viewer shows it: the preview, and the views of the visual metrics."""
