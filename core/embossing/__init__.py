"""Embossing of letters into the surface: patch, cut, draft, lift, check. Local, never a whole-mesh boolean."""
