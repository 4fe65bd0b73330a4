"""Pieces of HTML: texts that are escaped unless they are HTML already, and numbers in the reader's language."""

from __future__ import annotations

import base64
import hashlib
import math
from html import escape

NUMBERS_SCRIPT = (
    "for(const n of document.querySelectorAll('[data-digits]')){const d=+n.dataset.digits;"
    "n.textContent=new Intl.NumberFormat(undefined,{minimumFractionDigits:d,maximumFractionDigits:d})"
    ".format(n.getAttribute('value'))}"
)
"""Writes what `amount` gives as the reader's language does: of pages that have not the report's own script."""


class Html(str):
    """Text that is HTML already, and is not escaped again."""


def as_html(text: str) -> Html:
    """Return a text as HTML."""
    return text if isinstance(text, Html) else Html(escape(text))


def script_digest(script: str) -> str:
    """Return what the content security policy of a page knows a script by that it allows."""
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")


def amount(value: float, digits: int = 0) -> Html:
    """Return a number, which the page's script writes as the reader's language does; a dash for one that is not known.

    All numbers of four digits or with a fraction are written so: beside others, 1,234 would be taken for a fraction.
    """
    if not math.isfinite(value):
        return Html("–")
    return Html(f'<data value="{value:.{digits}f}" data-digits="{digits}">{value:,.{digits}f}</data>')


def amount_of(count: int, one: str) -> Html:
    """Return how many there are of what, as `amount` writes it: 1 fruit, 2 fruits."""
    return Html(f"{amount(count)} {one}{'s' * (count != 1)}")


def about(value: float, digits: int = 2) -> Html:
    """Return a number rounded to so many digits that count, or to a whole one; see `amount`."""
    if not math.isfinite(value):
        return Html("–")
    rounded = float(f"{value:.{digits}g}") if abs(value) < 10**digits else round(value)
    _, _, fraction = f"{rounded:.10f}".rstrip("0").partition(".")
    return amount(rounded, len(fraction))
