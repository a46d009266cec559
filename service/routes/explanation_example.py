"""Example of an explanation in the OpenAPI document: a box with one mark."""

from pydantic.config import JsonDict

EXPLANATION: JsonDict = {
    "schema": "meshmark.explanation/1",
    "stages": [
        {"stage": "candidates", "left": 1159, "dropped_because": None},
        {"stage": "aligned", "left": 882, "dropped_because": "the surface bends away from it or ends under it"},
    ],
    "searches": [{"width": 3.6755, "moved": False, "left": {"candidates": 1159, "aligned": 882}}],
    "objective": 0.482,
    "marks": [
        {
            "center": [-0.304, 0.718, -0.165],
            "normal": [0.029, 0.541, 0.84],
            "width": 3.6755,
            "covers": 0.054366,
            "costs": {"roll": 0.000103, "mark": 0.0003, "distance": 0.001039},
            "beside_others": 0.0,
            "views": 4,
        }
    ],
    "refused": [],
    "error": None,
}
