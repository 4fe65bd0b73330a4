"""At which stage of the pipeline a fruit went wrong, and how to say so."""

from __future__ import annotations

from typing import Literal

Kind = Literal["missed", "merged", "false", "double"]
Stage = Literal[
    "unplaced", "undetected", "covered", "weak", "once", "apart", "taken", "elsewhere", "dropped",
    "misplaced", "mixed", "nothing", "sides", "twice", "unknown",
]  # fmt: skip

KINDS: dict[Kind, str] = {
    "missed": "true fruits of which nothing was found",
    "merged": "true fruits whose centre lies in a found fruit that is not their match",
    "false": "found fruits where there is none",
    "double": "found fruits beside another found one of the same true fruit",
}
# In the order in which the pipeline comes to them.
STAGES: dict[Stage, str] = {
    "unplaced": "shown only by photos without a camera",
    "undetected": "no detection in any photo",
    "covered": "only inside detections of neighbours",
    "weak": "only detections too weak to be used",
    "once": "detected in one photo alone",
    "apart": "detected in several photos, not joined",
    "taken": "detected, and joined with another fruit",
    "elsewhere": "detected and joined, but placed wrongly",
    "dropped": "found, and then dropped by the filter",
    "nothing": "its detections show no true fruit",
    "mixed": "its detections show several true fruits",
    "misplaced": "a true fruit that is placed wrongly",
    "sides": "one true fruit, found once from each side",
    "twice": "one true fruit, found twice from the same side",
    "unknown": "nothing is known of its detections",
}
