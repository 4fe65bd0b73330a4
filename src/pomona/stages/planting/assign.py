"""Each fruit to the nearest trunk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.stages.planting.options import PlantingOptions
from pomona.values.fruits import Fruits
from pomona.values.trees import Trunks


def on_trees(fruits: Fruits, trunks: Trunks, options: PlantingOptions | None = None) -> Fruits:
    """Return n fruits with the id of the tree whose trunk is nearest, seen from above; 0 where trees are not known.

    `other_tree_ids` has the second nearest where the fruit is between the two. A fruit farther from every trunk than
    these stand apart is on none of them; of a single trunk, farther than trees may stand apart.
    """
    options = options or PlantingOptions()
    if len(trunks) == 0 or len(fruits) == 0:
        return fruits
    from scipy.spatial import cKDTree

    k = min(2, len(trunks))
    away, nearest = cKDTree(trunks.xy_in_world).query(fruits.centers_in_world[:, :2], k=k)
    away, nearest = (np.asarray(found).reshape(len(fruits), k) for found in (away, nearest))
    ids = trunks.ids[nearest]
    apart_m = trunks.spacing_m if len(trunks) > 1 else options.spacing_m or options.longest_m
    none = away[:, 0] > apart_m
    others = np.zeros(len(fruits), np.int64)
    if k == 2:
        apart = np.linalg.norm(trunks.xy_in_world[nearest[:, 0]] - trunks.xy_in_world[nearest[:, 1]], axis=1)
        # Between two trunks, the distances to them differ by twice that to the line midway.
        from_middle = (away[:, 1] ** 2 - away[:, 0] ** 2) / (2 * apart)
        others = np.where(from_middle < options.between * apart, ids[:, 1], 0)
    return replace(
        fruits,
        tree_ids=np.where(none, 0, ids[:, 0]),
        other_tree_ids=np.where(none, 0, others),
    )
