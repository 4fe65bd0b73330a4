"""Two surveys of one row on two dates: fruits matched one to one, growth, what is gone."""

from pomona.change.comparison import Comparison, Interval
from pomona.change.surveys import compare_surveys

__all__ = ["Comparison", "Interval", "compare_surveys"]
