"""Figures that others printed, each with where. Nothing is here that was not read there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """Figures by name, and where they are printed."""

    source: str
    figures: Mapping[str, float]


_PAPER = "Gené-Mola et al. 2020, doi 10.1016/j.compag.2019.105165"

# Rows of Table 2: confidence, R, P, F1.
_TABLE_2 = (
    (0.50, 0.8779, 0.7622, 0.8160),
    (0.55, 0.8746, 0.7737, 0.8211),
    (0.60, 0.8746, 0.7840, 0.8268),
    (0.65, 0.8729, 0.7991, 0.8344),
    (0.70, 0.8680, 0.8117, 0.8389),
    (0.75, 0.8663, 0.8242, 0.8447),
    (0.80, 0.8663, 0.8333, 0.8495),
    (0.85, 0.8647, 0.8465, 0.8555),
    (0.90, 0.8597, 0.8569, 0.8583),
    (0.95, 0.8399, 0.8761, 0.8576),
)
FUJI_TABLE_2 = Published(
    f"{_PAPER}, Table 2",
    {
        f"{name} at {confidence:g}": value
        for confidence, *values in _TABLE_2
        for name, value in zip(("R", "P", "F1"), values, strict=True)
    }
    | {"AP (IoU > 0.5)": 0.8599},
)
FUJI_TABLE_3 = {
    "training": Published(
        f"{_PAPER}, Table 3, training dataset",
        {"DR": 0.984, "R": 0.905, "P": 0.881, "FDR": 0.038, "MDR": 0.081, "F1": 0.893, "T": 434},
    ),
    "test": Published(
        f"{_PAPER}, Table 3, test dataset",
        {"DR": 0.991, "R": 0.906, "P": 0.857, "FDR": 0.037, "MDR": 0.106, "F1": 0.881, "T": 1021},
    ),
}
FUJI_FIGURE_8 = Published(f"{_PAPER}, Figure 8", {"R²": 0.80, "RMSE, %": 6.42})
FUJI_TILES = {"training": 231, "validation": 57}
FUJI_TREES = {"training": 3, "test": 8}

MINNEAPPLE = Published(
    "Häni et al., Mask R-CNN with ResNet-50, test set; README of github.com/nicolaihaeni/MinneApple, November 2019",
    {"AP (IoU 0.50 to 0.95)": 0.433, "AP50": 0.763},
)
WGISD = Published(
    "Santos et al. 2020, abstract, best of the instance segmentation; doi 10.1016/j.compag.2020.105247",
    {"best F1": 0.91},
)
FRUITNERF_RENDERED = Published(
    "FruitNeRF 2024 (Meyer et al., arXiv 2408.06190), best F1 of rendered trees with true masks", {"F1": 0.95}
)
FRUITNERF_COUNTS = {"tree_01": 179, "tree_02": 113, "tree_03": 291}
"""Fruits counted by hand on FruitNeRF's real trees (clustering/config_real.py of github.com/meyerls/FruitNeRF)."""
