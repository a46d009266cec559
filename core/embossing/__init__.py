"""How a watermark gets into the surface: patch, cut, lift, check - local surgery, never a whole-mesh boolean."""
