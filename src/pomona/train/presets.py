"""Options that suit an architecture, and the paper's."""

from __future__ import annotations

from dataclasses import replace

from pomona.errors import InputError
from pomona.train.augment import AugmentOptions
from pomona.train.center import CENTER_LITE0
from pomona.train.options import FitOptions
from pomona.train.stage import TrainOptions

PRESETS = ("paper",)
_PAPERS_ARCH = "maskrcnn-r101"

MASK_RCNN = FitOptions(
    batch=4,
    optimiser="sgd",
    learning_rate=5e-3,
    weight_decay=1e-4,
    warm_up=200,
    augment=AugmentOptions(crop_px=512, mosaics=0.2, copy_paste=0.3),
)
"""Torchvision's own rate for batches of four, with crops as for the shipped network and copy-paste."""

PAPER = FitOptions(
    batch=2,
    optimiser="sgd",
    learning_rate=0.001,
    momentum=0.9,
    weight_decay=0.0001,
    schedule="constant",
    warm_up=0,
    average=0.0,
    augment=AugmentOptions(crop_px=1024, fruit_px=None, stretch=0, mosaics=0, recolours=False),
)
"""Section 2.2.1: sub-images of 1024 × 1024 px as they are, horizontal flips alone, rate, momentum and weight decay.

The text gives no batch, schedule or anchors: they are those of the implementation it used (Abdulla 2017): two images on
a GPU, a constant rate, and anchors of 32 to 512 px in the proportions ½, 1 and 2, which are torchvision's too.
"""

PAPERS_EPOCHS = 18  # section 3.1


def options_for(arch: str | None = None, preset: str | None = None) -> TrainOptions:
    """Return the options of an architecture (None: the shipped one) or of a preset.

    Raises `InputError` for names that are not known or do not go together.
    """
    if preset is None:
        options = TrainOptions(arch=arch or CENTER_LITE0)
        return options if options.arch == CENTER_LITE0 else replace(options, fit=MASK_RCNN)
    if preset not in PRESETS:
        raise InputError(f"--preset: expected {' or '.join(PRESETS)}, found '{preset}'")
    options = TrainOptions(arch=arch or _PAPERS_ARCH, fit=PAPER, epochs=PAPERS_EPOCHS)
    if options.arch == CENTER_LITE0:
        raise InputError(f"--preset {preset} is of Mask R-CNN: expected an --arch maskrcnn-…, found {arch}")
    return options
