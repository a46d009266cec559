"""An example of a plan, for the OpenAPI document."""

from pydantic.config import JsonDict

PLAN: JsonDict = {
    "schema": "meshmark.plan/1",
    "engine": "1.0.0",
    "asset": "b94d27b9934d3e08a52e52d7da7dabfac484efe37a5380ee9088f7ace2efcde9",
    "parameters": {"text": "ORDER-4711"},
    "offset": [0.0, 1.2, 0.0],
    "scale": 15.0,
    "opaque": 0.25,
    "marks": [
        {
            "center": [0.0, 0.0, 7.5],
            "axes": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "size": [6.0, 1.0, 0.9],
            "line_height": 1.0,
            "color": "#101010",
            "glows": False,
            "contrast": 61.5,
            "lighter": False,
            "loss": 0.0,
            "roughness": 1.0,
            "views": [0, 1, 2],
        }
    ],
}
