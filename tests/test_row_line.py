"""The middle line of a row follows its bend, and is the straight one where the row is straight."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.basics.geometry import row_axis
from pomona.basics.row_line import row_line, walk_of


def bent_row(
    sagitta_m: float, seed: int = 0, *, count: int = 600, length_m: float = 60.0, turned_deg: float = 30.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points in a crown 1 m wide along an arc about (500, -80), and how far along and across of it they are.

    Trees stand 1.5 m apart, each off the line by 0.1 m (one standard deviation).
    """
    rng = np.random.default_rng(seed)
    along = rng.uniform(-length_m / 2, length_m / 2, count)
    trees = ((along + length_m / 2) / 1.5).astype(int)
    across = rng.uniform(-0.5, 0.5, count) + rng.normal(0, 0.1, trees.max() + 1)[trees]
    return on_arc(along, across, sagitta_m, length_m, turned_deg), along, across


def on_arc(
    along: np.ndarray, across: np.ndarray, sagitta_m: float, length_m: float = 60.0, turned_deg: float = 30.0
) -> np.ndarray:
    """Places (n, 3) at 1.5 m height, as far along and to the left of an arc, of which the sagitta is to its left."""
    bend = 8 * sagitta_m / length_m**2
    angle = along * bend
    xy = np.column_stack([along, np.zeros_like(along)])
    if bend:
        xy = np.column_stack([np.sin(angle), 1 - np.cos(angle)]) / bend
    xy = xy + across[:, None] * np.column_stack([-np.sin(angle), np.cos(angle)])
    a = np.deg2rad(turned_deg)
    turn = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    return np.column_stack([xy @ turn + [500, -80], np.full(len(xy), 1.5)])


@pytest.mark.parametrize("sagitta_m", [1.0, 2.0, -4.0, 8.0])
@pytest.mark.parametrize("turned_deg", [0.0, 80.0])
def test_a_bent_row_is_followed(sagitta_m: float, turned_deg: float) -> None:
    points, along, across = bent_row(sagitta_m, turned_deg=turned_deg)
    line = row_line(points)
    assert not line.is_straight
    found_along, found_across = line.along_across(points)
    assert np.abs(found_across - across).max() < 0.25
    assert np.sqrt(((found_across - across) ** 2).mean()) < 0.08
    assert np.std(found_along - along) < 0.05
    assert np.ptp(found_along) == pytest.approx(np.ptp(along), abs=0.1)


def test_the_walk_has_a_direction_there_and_back_but_not_around_a_tree() -> None:
    along, angle = np.linspace(0, 4, 9), np.linspace(0, 2 * np.pi, 24, endpoint=False)
    there = np.column_stack([along * 0.6, along * 0.8 - 2.5, np.ones(9)])
    walk = walk_of(np.concatenate([there, there[::-1] + np.array([2.4, -1.8, 0])]))
    assert walk is not None
    assert np.abs(walk) == pytest.approx([0.6, 0.8], abs=1e-6)
    assert walk_of(np.column_stack([np.cos(angle), np.sin(angle), np.ones(24)])) is None
    assert walk_of(there[:1]) is None


def test_several_photos_at_each_stop_do_not_hide_the_steps_between() -> None:
    """Five photos at each stop, a hand's breadth about it: most steps are short ones in any direction."""
    along = np.array([0.8, 0.6, 0.0])
    stops = np.arange(10)[:, None, None] * along
    photos = (stops + np.random.default_rng(0).normal(0, 0.04, (10, 5, 3))).reshape(-1, 3)
    walk = walk_of(photos)
    assert walk is not None
    assert abs(walk @ along[:2]) > 0.995
    # A row has a direction of its own.
    points = np.random.default_rng(0).uniform([0, -0.5, 0], [6, 0.5, 2], (100, 3))
    assert abs(row_line(points, walk).axis[0]) > 0.99
    assert row_line(points / [6, 1, 1], walk).axis == pytest.approx(walk)


def test_places_on_the_line_come_back() -> None:
    line = row_line(bent_row(3.0)[0])
    along = np.linspace(-50, 50, 60)  # beyond both ends of the row, too
    again, across = line.along_across(line.places(along))
    assert again == pytest.approx(along, abs=1e-3)
    assert across == pytest.approx(np.zeros(60), abs=1e-6)
    steps = np.linalg.norm(np.diff(line.places(along), axis=0), axis=1)
    assert steps == pytest.approx(np.diff(along), rel=2e-3)


def test_both_sides_of_a_bent_row_are_told_apart_beyond_its_ends() -> None:
    line = row_line(bent_row(4.0)[0])
    along = np.linspace(-31, 31, 50)
    for aside in (-2.5, 2.5):
        found_along, found_across = line.along_across(on_arc(along, np.full(50, aside), 4.0))
        assert found_across == pytest.approx(np.full(50, aside), abs=0.2)
        assert np.abs(found_along - along - np.median(found_along - along)).max() < 0.25


@pytest.mark.parametrize("length_m", [4.0, 12.0, 60.0])
def test_a_straight_row_is_as_before(length_m: float) -> None:
    bent = 0
    for seed in range(40):
        points, _, _ = bent_row(0.0, seed, length_m=length_m, count=300)
        line, (origin, axis) = row_line(points), row_axis(points)
        bent += not line.is_straight
        if line.is_straight:
            off = points[:, :2] - origin
            along, across = line.along_across(points)
            assert along == pytest.approx(off @ axis, abs=1e-9)
            assert across == pytest.approx(off @ [-axis[1], axis[0]], abs=1e-9)
    assert bent <= 1


def test_points_far_away_do_not_bend_the_line() -> None:
    points, along, across = bent_row(2.0)
    strays = on_arc(np.linspace(-20, 25, 40), np.full(40, 6.0), 2.0)  # of the next row
    _, found = row_line(np.concatenate([points, strays])).along_across(points)
    assert np.sqrt(((found - across) ** 2).mean()) < 0.12
    assert len(along) == len(found)


def test_too_few_points_and_points_on_one_spot_make_a_straight_line() -> None:
    few = bent_row(4.0, count=20)[0]
    for points in (few, few[:1], np.repeat(few[:1], 100, axis=0)):
        line = row_line(points)
        assert line.is_straight
        assert np.isfinite(line.along_across(points)).all()
