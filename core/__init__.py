"""The Meshmark engine: bytes in, watermarked bytes and a report out.

Knows no HTTP, no queue and no database. Every length is in the size-30 frame (the asset scaled so that its
largest bounding-box side is 30 and centred at the origin, paper supplement "Implementation Details") unless a
name says otherwise.
"""

import os

# onnxruntime reports what it is used for to its makers unless told not to before it is loaded (its docs/Privacy.md).
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

__version__ = "0.1.0"
