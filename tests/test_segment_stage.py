"""The stage: scale by the fruits' size, masks back in the photo's pixels, ids, photos that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pomona.errors import InputError
from pomona.pipeline import RunOptions
from pomona.progress import Silent
from pomona.stages.segment import SegmenterTraits, SegmentOptions, iter_detections, scales_of, segment_photos
from pomona.stages.segment.protocol import TileDetections
from pomona.stages.segment.resize import resized_detections, resized_mask
from pomona.values.detections import Mask
from pomona.values.photos import Photo, Photos
from segment_scenes import RedSegmenter, disc, red_photo, red_photos


def test_every_photo_has_its_fruits_and_ids_count_on(tmp_path: Path) -> None:
    photos = red_photos(tmp_path)
    found = segment_photos(photos, RedSegmenter())
    assert list(found) == list(photos.names)
    assert [len(found[name]) for name in found] == [1, 2, 3]
    assert np.concatenate([d.ids for d in found.values()]).tolist() == [1, 2, 3, 4, 5, 6]
    for k, mask in enumerate(sorted(found["p2.jpg"].masks, key=lambda m: m.x_px)):
        assert mask.iou(Mask.from_pixels(disc(400, 300, 60 + 90 * k, 80 + 30 * k, 20))) > 0.9


def test_done_photos_are_not_done_again(tmp_path: Path) -> None:
    photos = red_photos(tmp_path)
    first = next(iter_detections(photos, RedSegmenter()))
    photos.items[0].path.unlink()
    again = list(iter_detections(photos, RedSegmenter(), done={first.photo: first}))
    assert again[0] is first
    assert np.concatenate([d.ids for d in again]).tolist() == [1, 2, 3, 4, 5, 6]


def test_a_photo_that_breaks_is_named_and_left_out(tmp_path: Path) -> None:
    photos = red_photos(tmp_path)
    photos.items[1].path.write_bytes(photos.items[1].path.read_bytes()[:700])
    progress = Silent()
    found = segment_photos(photos, RedSegmenter(), progress=progress)
    assert list(found) == ["p0.jpg", "p2.jpg"]
    (said,) = [warning for warning in progress.warnings if "p1.jpg" in warning]
    assert said.startswith("p1.jpg is left out: its pixels cannot be decoded (")


def test_no_fruit_in_any_photo_is_an_empty_valid_result(tmp_path: Path) -> None:
    photos = Photos(tuple(red_photo(tmp_path / f"{k}.jpg", 200, 150, []) for k in range(2)))
    progress = Silent()
    found = segment_photos(photos, RedSegmenter(typical_fruit_px=40, fruit_px=(20, 80)), progress=progress)
    assert list(found) == ["0.jpg", "1.jpg"]
    assert found.total == 0
    assert progress.warnings == ["No fruit was found in any of 2 photos."]


@pytest.mark.parametrize("radius", [14, 35, 90])
def test_photos_are_read_at_the_scale_at_which_fruits_are_known(tmp_path: Path, radius: int) -> None:
    centres = [(200.0 + 250 * i, 200.0 + 250 * j, float(radius)) for i in range(2) for j in range(2)]
    photos = Photos((red_photo(tmp_path / "a.jpg", 650, 620, centres),))
    segmenter = RedSegmenter(typical_fruit_px=40, fruit_px=(16, 100))
    scales = scales_of(photos, segmenter, SegmentOptions(), Silent()).by_name
    assert scales["a.jpg"] == pytest.approx(min(40 / (2 * radius), 2.0), rel=0.25)
    found = segment_photos(photos, segmenter)["a.jpg"]
    assert len(found) == 4
    truth = [Mask.from_pixels(disc(650, 620, *c)) for c in centres]
    assert min(max(m.iou(t) for m in found.masks) for t in truth) > 0.8


def test_fruits_of_nearly_one_width_give_the_same_scale(tmp_path: Path) -> None:
    """So that photos that are added leave alone what was found in the others."""
    segmenter = RedSegmenter(typical_fruit_px=40, fruit_px=(16, 100))
    scales = []
    for radius in (25.0, 25.5, 26.0):
        photo = red_photo(tmp_path / f"{radius}.jpg", 650, 620, [(200.0, 200.0, radius), (450.0, 450.0, radius)])
        found = scales_of(Photos((photo,)), segmenter, SegmentOptions(), Silent())
        scales.append(found.by_name[photo.name])
    assert len(set(scales)) == 1
    assert 6 * np.log2(scales[0]) == pytest.approx(round(6 * np.log2(scales[0])))
    assert scales[0] == pytest.approx(40 / 51, rel=0.13)


@pytest.mark.slow
def test_photos_that_were_read_to_find_their_scale_are_not_read_again(tmp_path: Path) -> None:
    """Large photos, whose small copies do not do: what is found is what is found at that scale alone."""
    fruits = [(300.0 + 240 * i, 300.0 + 240 * j, 20.0) for i in range(6) for j in range(4)]
    photos = Photos(tuple(red_photo(tmp_path / f"{k}.jpg", 1800, 1400, fruits) for k in range(3)))
    segmenter = RedSegmenter(typical_fruit_px=40, fruit_px=(16, 100))
    scales = scales_of(photos, segmenter, SegmentOptions(), Silent())
    assert scales.by_name == dict.fromkeys(photos.names, 1.0)
    assert 1 <= len(scales.seen) <= 2
    before = len(segmenter.sizes)
    found = {d.photo: d for d in iter_detections(photos, segmenter, scales=scales)}
    looks = len(segmenter.sizes) - before
    alone = segment_photos(photos, segmenter, options=SegmentOptions(scale=1.0))
    assert looks * 3 == (len(segmenter.sizes) - before - looks) * (3 - len(scales.seen))
    for name, of_photo in alone.items():
        np.testing.assert_array_equal(found[name].boxes_px, of_photo.boxes_px)
        np.testing.assert_array_equal(found[name].scores, of_photo.scores)
        np.testing.assert_array_equal(found[name].ids, of_photo.ids)


def test_sides_and_cameras_have_scales_of_their_own(tmp_path: Path) -> None:
    near = [(150.0 + 200 * k, 150.0, 60.0) for k in range(3)]
    far = [(60.0 + 80 * k, 150.0, 20.0) for k in range(8)]
    photos = Photos(
        (
            red_photo(tmp_path / "a.jpg", 800, 300, near, side="east"),
            red_photo(tmp_path / "b.jpg", 800, 300, far, side="west"),
        )
    )
    segmenter = RedSegmenter(typical_fruit_px=40, fruit_px=(16, 150))
    scales = scales_of(photos, segmenter, SegmentOptions(sample_photos=2), Silent()).by_name
    assert scales["b.jpg"] / scales["a.jpg"] == pytest.approx(3, rel=0.25)


def test_segmenters_without_a_typical_width_read_photos_at_full_size(tmp_path: Path) -> None:
    segmenter = RedSegmenter(tile_px=128, min_overlap_px=32)
    segment_photos(red_photos(tmp_path, 1), segmenter)
    assert set(segmenter.sizes) == {(128, 128)}
    assert len(segmenter.sizes) == 4 * 3


def test_scale_can_be_given(tmp_path: Path) -> None:
    segmenter = RedSegmenter()
    found = segment_photos(red_photos(tmp_path, 1), segmenter, options=SegmentOptions(scale=0.5))
    assert segmenter.sizes == [(150, 200)]
    (mask,) = found["p0.jpg"].masks
    assert mask.iou(Mask.from_pixels(disc(400, 300, 60, 80, 20))) > 0.9


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"score_threshold": 1.5}, "`score_threshold`: expected 0 to 1, found 1.5"),
        ({"tile_px": 10}, "`tile_px`: expected at least 64"),
        ({"scale": 0.0}, "`scale`: expected over 0"),
        ({"scale": 5.0}, "`scale`: expected over 0"),
        ({"sample_photos": 0}, "sample_photos"),
    ],
)
def test_unknown_option_values_are_refused(fields: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        SegmentOptions(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"score_threshold": -0.1}, "score_threshold"),
        ({"typical_fruit_px": 0.0}, "typical_fruit_px"),
        ({"fruit_px": (30.0, 20.0)}, "smallest and a larger"),
    ],
)
def test_senseless_traits_are_refused(fields: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        SegmenterTraits(**fields)  # type: ignore[arg-type]


class FaintSegmenter(RedSegmenter):
    """Gives the red areas of a photo scores of 0.9, 0.2, 0.05, from left to right."""

    def _of(self, tile: np.ndarray) -> TileDetections:
        found = super()._of(tile)
        found = found[np.argsort(found.boxes_px[:, 0])]
        return TileDetections(found.boxes_px, np.array([0.9, 0.2, 0.05][: len(found)]), found.masks)


def test_weak_detections_are_kept_and_do_not_count(tmp_path: Path) -> None:
    photos = red_photos(tmp_path, 3)
    for options in (None, SegmentOptions(), SegmentOptions(sample_photos=5)):
        found = segment_photos(photos, FaintSegmenter(), options=options)  # its threshold is 0.5
        assert found["p2.jpg"].scores.tolist() == [0.9, 0.2]
        assert found.at_least(0.5)["p2.jpg"].scores.tolist() == [0.9]
    for share, scores in ((1.0, [0.9]), (0.05, [0.9, 0.2, 0.05])):
        found = segment_photos(photos, FaintSegmenter(), options=SegmentOptions(kept_share=share))
        assert found["p2.jpg"].scores.tolist() == scores


def test_options_of_the_stage_keep_what_the_usual_ones_keep() -> None:
    given = RunOptions(segment=SegmentOptions(sample_photos=5)).of_stages.segment
    assert given.kept_share == RunOptions().of_stages.segment.kept_share == 0.2


def test_score_threshold_of_the_options_counts(tmp_path: Path) -> None:
    photos, progress = red_photos(tmp_path, 1), Silent()
    options = SegmentOptions(score_threshold=0.95, kept_share=1)
    assert segment_photos(photos, RedSegmenter(), options=options, progress=progress).total == 0
    assert progress.warnings == ["No fruit was found in any of 1 photo."]


def test_weak_detections_alone_are_no_fruit(tmp_path: Path) -> None:
    photos, progress = red_photos(tmp_path, 1), Silent()
    options = SegmentOptions(score_threshold=0.95)
    assert segment_photos(photos, RedSegmenter(), options=options, progress=progress).total == 1
    assert progress.warnings == ["No fruit was found in any of 1 photo."]


@pytest.mark.parametrize("factor", [0.5, 1.7, 4.0])
def test_resized_masks_keep_place_and_area(factor: float) -> None:
    mask = Mask.from_pixels(disc(100, 80, 43.3, 37.7, 15))
    to = round(100 * factor), round(80 * factor)
    found = resized_mask(mask, (100, 80), to)
    assert found is not None
    assert found.area_px == pytest.approx(mask.area_px * factor**2, rel=0.04)
    np.testing.assert_allclose(found.center_px / factor, mask.center_px, atol=0.3)


def test_resized_masks_stay_cut_straight_at_the_photos_edge() -> None:
    mask = Mask.from_pixels(disc(100, 80, 2, 40, 15))
    found = resized_mask(mask, (100, 80), (300, 240))
    assert found is not None
    assert found.x_px == 0
    assert abs(found.pixels[:, 0].sum() - 3 * mask.pixels[:, 0].sum()) <= 3


def test_masks_of_less_than_a_pixel_vanish() -> None:
    dot = Mask.from_pixels(np.ones((1, 1), bool), 10, 10)
    found = TileDetections(np.zeros((1, 4)), np.array([0.9]), (dot,))
    assert len(resized_detections(found, (100, 100), (10, 10))) == 0
    assert resized_detections(found, (100, 100), (100, 100)) is found


def test_photos_that_are_gone_leave_the_others(tmp_path: Path) -> None:
    gone = Photo(name="gone.jpg", path=tmp_path / "gone.jpg", width_px=400, height_px=300)
    photos = Photos((gone, *red_photos(tmp_path, 1).items))
    progress = Silent()
    found = segment_photos(photos, RedSegmenter(typical_fruit_px=40, fruit_px=(10, 90)), progress=progress)
    assert list(found) == ["p0.jpg"]
    assert "gone.jpg" in progress.warnings[0]


def test_where_photos_show_few_fruits_more_of_them_tell_the_scale(tmp_path: Path) -> None:
    # The two photos that are looked at first show fruits three times as wide as all the others.
    radii = [20, 20, 60, 20, 20, 20, 60, 20]
    photos = Photos(
        tuple(red_photo(tmp_path / f"{k}.jpg", 800, 600, [(400.0, 300.0, float(r))]) for k, r in enumerate(radii))
    )
    segmenter = RedSegmenter(typical_fruit_px=40, fruit_px=(16, 150))
    scales = scales_of(photos, segmenter, SegmentOptions(sample_photos=2), Silent()).by_name
    assert scales["0.jpg"] == pytest.approx(1.0, rel=0.25)


@pytest.mark.parametrize("at_once", [1, 2, 5])
def test_photos_segmented_at_the_same_time_come_out_the_same(tmp_path: Path, at_once: int) -> None:
    photos = red_photos(tmp_path)
    photos.items[1].path.write_bytes(b"no photo any more")
    progress = Silent()
    found = segment_photos(photos, RedSegmenter(at_once=at_once), progress=progress)
    assert [(name, d.ids.tolist()) for name, d in found.items()] == [("p0.jpg", [1]), ("p2.jpg", [2, 3, 4])]
    assert [mask.box_px for mask in found["p2.jpg"].masks] == [
        mask.box_px for mask in segment_photos(photos, RedSegmenter())["p2.jpg"].masks
    ]
    assert any("p1.jpg is left out" in warning for warning in progress.warnings)
