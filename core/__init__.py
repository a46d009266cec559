"""The Meshmark engine: bytes in, watermarked bytes and a report out.

Knows no HTTP, no queue and no database. Every length is in the size-30 frame (the asset scaled so that its
largest bounding-box side is 30 and centred at the origin, paper supplement "Implementation Details") unless a
name says otherwise.
"""

from core import process

process.before_onnxruntime()

__version__ = "0.1.0"
