"""Facts about a surface that placement weighs: distinct, flipped, opaque and cuttable faces, components, saliency,
texture, contrast, skin deformation, and the regions of a request."""
