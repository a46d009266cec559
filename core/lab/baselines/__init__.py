"""Baselines to compare Meshmark with: strategies of one signature, looked up by name."""

from core.lab.baselines.ablation import ABLATED
from core.lab.baselines.li import li
from core.lab.baselines.meshmark import (
    meshmark,
    meshmark_default,
    meshmark_discreet,
    meshmark_flat,
    meshmark_strong,
)
from core.lab.baselines.paper import paper, paper_no_curve_matching, paper_no_filtering, paper_no_optimization
from core.lab.baselines.strategy import Strategy

STRATEGIES: dict[str, Strategy] = {
    "meshmark": meshmark,
    "meshmark-default": meshmark_default,
    "meshmark-flat": meshmark_flat,
    "meshmark-discreet": meshmark_discreet,
    "meshmark-strong": meshmark_strong,
    "li": li,
    "paper": paper,
    "paper-no-curve-matching": paper_no_curve_matching,
    "paper-no-optimization": paper_no_optimization,
    "paper-no-filtering": paper_no_filtering,
    **ABLATED,
}
