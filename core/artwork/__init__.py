"""From a text and a font to the closed outlines that are embossed."""
