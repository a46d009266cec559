"""Numbers and tables as Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass

from core.lab.benchmark.statistics import Mean, PowerLaw

NOTHING = "-"


@dataclass(frozen=True)
class Metric:
    """Presentation of a metric.

    Attributes:
        name: in the rows.
        label: in tables, without its direction.
        higher: more is better.
        unit: of lengths; empty for shares, similarities and counts.
    """

    name: str
    label: str
    higher: bool
    unit: str = ""

    @property
    def heading(self) -> str:
        """The label with its unit and direction."""
        return f"{self.label}{f' [{self.unit}]' if self.unit else ''} {'↑' if self.higher else '↓'}"


METRICS = {
    metric.name: metric
    for metric in (
        Metric("wps", "WPS", True),
        Metric("wps_area", "WPS area", True),
        Metric("ray", "Ray", True),
        Metric("coverage", "Coverage", True),
        Metric("crop_survival", "Crop survival", True),
        Metric("prominence", "Prominence", True),
        Metric("prominence_least", "Prominence, least", True),
        Metric("ocr", "OCR clay", True),
        Metric("ocr_ge_0.8", "OCR clay ≥ 0.8", True),
        Metric("ocr_exact", "OCR clay exact", True),
        Metric("ocr_color", "OCR clay, letters coloured", True),
        Metric("ocr_delivered", "OCR as delivered", True),
        Metric("ocr_delivered_ge_0.8", "OCR as delivered ≥ 0.8", True),
        Metric("smse", "SMSE", False, "u"),
        Metric("ipe", "IPE", False, "parts"),
        Metric("lce", "LCE", False, "u²"),
        Metric("lce_pooled", "LCE pooled", False, "u²"),
        Metric("se", "SE", False),
        Metric("se_lee2005", "SE (Lee 2005)", False),
        Metric("ss", "SS", True),
        Metric("bit_accuracy", "Bit accuracy", True),
        Metric("recovered", "Shape regained", False),
        Metric("ocr_relief", "OCR relief", True),
        Metric("stripped", "Stripped", False),
        Metric("survived", "Marks whole", True),
    )
}


def number(value: float) -> str:
    """Three decimals, fewer for large numbers, powers of ten for tiny ones."""
    size = abs(value)
    if value == 0:
        return "0"
    if size < 0.0005:
        return f"{value:.1e}"
    if size < 0.01:
        return f"{value:.4f}"
    return f"{value:.3f}" if size < 10 else f"{value:,.1f}"


def interval(found: Mean | None) -> str:
    """``mean ± half of the 95% interval``."""
    if found is None:
        return NOTHING
    return number(found.value) + (f" ± {number(found.half)}" if found.half else "")


def exponent(law: PowerLaw | None) -> str:
    """The exponent of a power law ``± half of the 95% interval``."""
    return NOTHING if law is None else f"{number(law.exponent)} ± {number(law.half)}"


def amount(found: Mean | None) -> str:
    """A mean of whole numbers."""
    return NOTHING if found is None else f"{found.value:.1f}".removesuffix(".0")


def best(means: Sequence[Mean | None], higher: bool) -> list[str]:
    """Each mean as text, the best in bold; all that read the same as the best one share it."""
    there = [found.value for found in means if found is not None]
    if len(there) < 2:
        return [interval(found) for found in means]
    top = number(max(there) if higher else min(there))
    return [f"**{interval(found)}**" if found and number(found.value) == top else interval(found) for found in means]


def table(header: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    """A Markdown table, the first column left-aligned and the others right-aligned."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in [header, rule, *body])


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
