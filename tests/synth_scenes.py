"""Small rendered rows for tests."""

from pathlib import Path
from typing import Any

import pytest

from pomona.errors import MissingExtraError
from pomona.learning.synth import RowOptions, render_row


def rough_row(out: Path, **options: Any) -> Path:
    """Render a tree of 25 fruits from both sides; where OpenGL cannot be used, the test is skipped and says so."""
    small: dict[str, Any] = {"width_px": 200, "height_px": 300}
    row = RowOptions(
        seed=5, trees=1, fruits_per_tree=25, leaves_per_tree=150, photos_per_side=1, rough=True, **(small | options)
    )
    try:
        return render_row(row, out)
    except MissingExtraError as error:
        pytest.skip(str(error))
