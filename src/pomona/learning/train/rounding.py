"""Weights of a convolution in whole numbers, rounded so that what it says of its inputs changes as little as possible.

Each weight's rounding error is made up for by those that are not rounded yet, as far as their inputs go together.
Source: Frantar et al. 2023, GPTQ, section 3 (after LeCun et al. 1990, optimal brain damage).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray

_LARGEST = 127
# Processors without VNNI add the products of two weights and two bytes in sixteen bits, signed: 255 · 128 < 2¹⁵.
_LARGEST_OF_TWO = 128
_DAMPING = 0.01  # of the inputs' mean square


@dataclass(frozen=True, eq=False)
class Rounded:
    """Whole weights (g, o, k), from −127 to 127, the scales (g, o) that they are multiplied by, and by how much each
    output (g, o) falls short of what floats would give on average."""

    whole: IntArray
    scales: FloatArray
    shortfalls: FloatArray


def rounded(weights: FloatArray, inputs: FloatArray, least_scales: FloatArray, *, in_pairs: bool) -> Rounded:
    """Round weights (g, o, k) of g groups of o outputs, given some inputs (g, n, k) of each group.

    Scales are `least_scales` (g, o) at least. `in_pairs`: of two weights that follow each other the absolute values add
    up to 128 at most.
    """
    k = weights.shape[2]
    largest = np.abs(weights).max(2) / _LARGEST
    if in_pairs:
        sizes = np.abs(np.pad(weights, ((0, 0), (0, 0), (0, k % 2))))
        largest = np.maximum(largest, (sizes[:, :, ::2] + sizes[:, :, 1::2]).max(2) / _LARGEST_OF_TWO)
    scales = np.maximum(largest, least_scales)
    left, whole = weights.astype(np.float64), np.zeros(weights.shape)
    shares = _shares(inputs)
    for i in range(k):
        most: float | FloatArray = _LARGEST
        if in_pairs and i % 2:
            most = np.minimum(_LARGEST, _LARGEST_OF_TWO - np.abs(whole[:, :, i - 1]))
        whole[:, :, i] = np.clip(np.rint(left[:, :, i] / scales), -most, most)
        error = (left[:, :, i] - whole[:, :, i] * scales) / shares[:, None, i, i]
        left[:, :, i:] -= error[:, :, None] * shares[:, None, i, i:]
    means = inputs.mean(1)
    shortfalls = np.einsum("gok,gk->go", weights - whole * scales[:, :, None], means)
    return Rounded(whole.astype(np.int64), scales, shortfalls)


def _shares(inputs: FloatArray) -> FloatArray:
    """Return the upper factor (g, k, k) of the inverse of the inputs' second moments.

    A row says by what shares of a weight's error the weights behind it make up for that.
    """
    inputs = np.ascontiguousarray(inputs, np.float64)  # the product of others takes a hundred times as long
    moments = np.swapaxes(inputs, 1, 2) @ inputs / inputs.shape[1]
    diagonal = np.einsum("gkk->gk", moments)
    diagonal += _DAMPING * diagonal.mean(1, keepdims=True) + 1e-12  # a view: of the moments themselves
    return np.swapaxes(np.linalg.cholesky(np.linalg.inv(moments)), 1, 2)
