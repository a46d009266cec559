"""The paper's own numbers (Singh et al., WACV 2025), table by table; methods under the names used here."""

from typing import Final

Values = dict[str, float]

# Tab. 1, "Comparison results": dataset -> method -> metric. LCE of 0.000 on Manifold40 is rounded there.
QUALITY: Final[dict[str, dict[str, Values]]] = {
    "Manifold40": {
        "li": {
            "wps": 0.280,
            "ray": 0.706,
            "ocr": 0.301,
            "smse": 0.006,
            "ipe": 20.525,
            "lce": 0.022,
            "se": 0.102,
            "ss": 0.795,
        },
        "paper": {
            "wps": 0.484,
            "ray": 0.920,
            "ocr": 0.369,
            "smse": 0.002,
            "ipe": 0.575,
            "lce": 0.000,
            "se": 0.093,
            "ss": 0.832,
        },
    },
    "ObjaVerse": {
        "li": {
            "wps": 0.203,
            "ray": 0.588,
            "ocr": 0.201,
            "smse": 0.009,
            "ipe": 19.400,
            "lce": 0.038,
            "se": 0.168,
            "ss": 0.792,
        },
        "paper": {
            "wps": 0.420,
            "ray": 0.788,
            "ocr": 0.355,
            "smse": 0.002,
            "ipe": 4.820,
            "lce": 0.002,
            "se": 0.021,
            "ss": 0.811,
        },
    },
    "Meshy": {
        "li": {
            "wps": 0.207,
            "ray": 0.837,
            "ocr": 0.362,
            "smse": 0.0075,
            "ipe": 27.75,
            "lce": 0.0293,
            "se": 0.146,
            "ss": 0.822,
        },
        "paper": {
            "wps": 0.411,
            "ray": 0.993,
            "ocr": 0.526,
            "smse": 0.0017,
            "ipe": 0.35,
            "lce": 0.0006,
            "se": 0.020,
            "ss": 0.856,
        },
    },
}

# Tab. 2, "Ablation", on ObjaVerse.
ABLATION: Final[dict[str, Values]] = {
    "paper": {"wps": 0.420, "ray": 0.788, "ocr": 0.355, "smse": 0.002, "ipe": 4.820, "lce": 0.002, "ss": 0.811},
    "paper-no-curve-matching": {
        "wps": 0.420,
        "ray": 0.788,
        "ocr": 0.294,
        "smse": 0.002,
        "ipe": 4.820,
        "lce": 0.021,
        "ss": 0.781,
    },
    "paper-no-optimization": {
        "wps": 0.225,
        "ray": 0.543,
        "ocr": 0.232,
        "smse": 0.005,
        "ipe": 3.800,
        "lce": 0.015,
        "ss": 0.786,
    },
    "paper-no-filtering": {
        "wps": 0.287,
        "ray": 0.594,
        "ocr": 0.259,
        "smse": 0.002,
        "ipe": 7.870,
        "lce": 0.004,
        "ss": 0.800,
    },
    "li": {"wps": 0.203, "ray": 0.588, "ocr": 0.201, "smse": 0.009, "ipe": 19.400, "lce": 0.038, "ss": 0.792},
}

# Tab. 3, "Attacks", on Manifold40: attack -> method -> metric.
ATTACKS: Final[dict[str, dict[str, Values]]] = {
    "none": {
        "li": {"ray": 0.706, "ocr": 0.301, "ipe": 20.525, "ss": 0.795},
        "paper": {"ray": 0.920, "ocr": 0.369, "ipe": 0.575, "ss": 0.832},
    },
    "crop": {
        "li": {"ray": 0.501, "ocr": 0.093, "ipe": 9.650, "ss": 0.685},
        "paper": {"ray": 0.569, "ocr": 0.120, "ipe": 4.050, "ss": 0.716},
    },
    "removal": {
        "li": {"ray": 0.541, "ocr": 0.211, "ipe": 20.350, "ss": 0.918},
        "paper": {"ray": 0.920, "ocr": 0.356, "ipe": 29.025, "ss": 0.927},
    },
}

# Tab. 4, "Comparison with invisible method, Wang et al.", on Manifold40.
INVISIBLE: Final[dict[str, Values]] = {
    "invisible": {"ray": 0.000, "ocr": 0.000, "smse": 7.81e-9, "ss": 0.999},
    "paper": {"ray": 0.920, "ocr": 0.369, "smse": 0.002, "ss": 0.832},
}

# Supplement, "Dataset Statistics": samples, then min, max, mean of vertices and of faces.
STATISTICS: Final[dict[str, tuple[int, float, float, float, float, float, float]]] = {
    "Manifold40": (50, 6561, 137055, 56943.2, 13134, 160004, 101312.9),
    "ObjaVerse": (50, 64933, 1122245, 234601.5, 130088, 182460, 159874.9),
    "Meshy": (20, 9058, 37273, 20981.5, 18086, 74512, 41924.8),
}

# Supplement, "Runtime Analysis": vertices and seconds, on 12 CPU cores with two GeForce GTX 1080.
RUN_TIME: Final[tuple[tuple[int, float], ...]] = ((60_000, 30.0), (1_200_000, 180.0))
