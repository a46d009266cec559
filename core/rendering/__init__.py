"""Pictures of a GLB as an ordinary glTF viewer shows it: what the preview and the visual metrics look at."""
