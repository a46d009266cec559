"""A verification's report as an example: the result of the demo against its job; figures are rounded."""

from pydantic.config import JsonDict

VERIFICATION: JsonDict = {
    "schema": "meshmark.verification/1",
    "file": {
        "sha256": "c5aebf437a61b83cbe5b00db2952670b75418dada98bc8cdb83c18e398a2930b",
        "bytes": 249232,
        "format": "glb",
    },
    "engine": {"version": "0.1.0", "device": "cpu"},
    "texts": ["SAMPLE"],
    "found": ["SAMPLE"],
    "marks": [
        {
            "text": "SAMPLE",
            "known": "SAMPLE",
            "likeness": 1.0,
            "confidence": 0.998,
            "votes": 9,
            "pictures": ["ordinary", "relief"],
            "center": [-0.3008, 0.721, -0.1633],
            "right": [0.9998, -0.00275, -0.02172],
            "normal": [0.01991, 0.5263, 0.8501],
            "length": 0.2344,
            "pixel": None,
        }
    ],
    "label": None,
    "credentials": {
        "state": "trusted",
        "codes": [],
        "issuer": "Example Ltd",
        "name": "Example Ltd's signer",
        "time": None,
        "generator": "Meshmark 0.1.0",
        "title": "spot.watermarked.glb",
        "source_type": None,
        "actions": ["c2pa.opened", "c2pa.edited"],
        "marks": ["SAMPLE"],
    },
    "original": {
        "file": {
            "sha256": "f36cd127185a8d9cbd9a6aeafde981f992716a6546ec3f9486540c657883e6cd",
            "bytes": 218416,
            "format": "glb",
        },
        "is_asset": True,
        "is_result": True,
        "scale": 1.0,
        "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "translation": [0.0, 0.0, 0.0],
        "residual": 0.0,
        "covered": 1.0,
        "marks": [
            {
                "index": 0,
                "text": "SAMPLE",
                "present": True,
                "correlation": 0.995,
                "standing_out": 0.41,
                "height": 0.00637,
                "surface": 1.0,
            }
        ],
    },
    "warnings": [],
    "timings": {"all": 8.31},
}
