"""Long rows: what looks only at neighbours finds what looking at all would find, which is kept here as the oracle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_matrix, csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.transform import Rotation

from fuse_scenes import cameras_in_a_row
from pomona.adjustment.bundle import adjust
from pomona.adjustment.covariance import covariance, focal_sds
from pomona.adjustment.normal_equations import normal_equations
from pomona.adjustment.selected_inverse import SelectedInverse
from pomona.adjustment.weights import Landmark, Weights, weighted
from pomona.basics.arrays import BoolArray, Float32Array, FloatArray, IntArray, among, groups
from pomona.basics.geometry import estimate_similarity
from pomona.errors import FormatError
from pomona.fruit.crops.sights import images_px
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.dense.neighbours import choose_neighbours
from pomona.stages.dense.options import DenseOptions
from pomona.stages.filter.options import FilterOptions
from pomona.stages.filter.view_features import seen_shares
from pomona.stages.measure.allometry import STORY_APPLES
from pomona.stages.measure.neighbours import edges_of_others
from pomona.stages.measure.spheroid_fit import SpheroidEvidence, SpheroidPrior, fit_spheroids
from pomona.stages.measure.spheroids import Spheroids
from pomona.stages.planting.summary import trees_of
from pomona.stages.planting.trunk_table import read_trunks
from pomona.stages.second_look import SecondLookOptions
from pomona.stages.second_look.evidence import Evidence, find_sights
from pomona.stages.second_look.explained import unexplained
from pomona.stages.second_look.peaks import Peaks
from pomona.stages.sfm.models import Model
from pomona.stages.sfm.seams import worst_seam
from pomona.stages.sfm.selection import FULL_WEIGHT, take
from pomona.stages.yields.encounters import encounters_of
from pomona.stages.yields.options import YieldOptions
from pomona.values.cameras import Cameras
from pomona.values.fruits import Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.trees import Trunks
from scale_scenes import bent, photographed

ROW = cameras_in_a_row(60)  # 9 m


def row_of_two_lenses() -> Cameras:
    """A row whose photos are held unevenly, every third by a longer lens."""
    turns = Rotation.from_rotvec(np.random.default_rng(1).normal(0, 0.06, (len(ROW), 3))).as_matrix()
    rotations = turns @ ROW.cam_from_world[:, :, :3]
    poses = np.concatenate([rotations, -rotations @ ROW.centers_in_world[:, :, None]], axis=2)
    longer = replace(ROW.intrinsics[0], params=ROW.intrinsics[0].params * [1.3, 1.3, 1, 1])
    lens_idx = (np.arange(len(ROW)) % 3 == 0).astype(np.int64)
    return replace(ROW, intrinsics=(ROW.intrinsics[0], longer), intrinsics_idx=lens_idx, cam_from_world=poses)


def photographed_along(length_m: float, photos: int, *, noise_px: float = 0.3, seed: int = 0) -> Cameras:
    """A long row seen from one side as mapping gives it: 40 points a metre, each seen by about four photos."""
    row = photographed(
        "east", length_m=length_m, photos=photos, points=round(40 * length_m), noise_px=noise_px, seed=seed
    )
    random = np.random.default_rng(seed)
    apart = row.centers_in_world[row.track_photo_idx, 0] - row.points_in_world[row.track_point_idx, 0]
    kept = (np.abs(apart) < 0.7) & (random.random(len(apart)) < 0.9)
    tracks = {name: getattr(row, name)[kept] for name in ("track_point_idx", "track_photo_idx", "track_xy_px")}
    row = replace(row, **tracks)
    return take(Model(row, np.arange(photos), np.ones(photos)), np.ones(photos, bool)).cameras


def marked(cameras: Cameras, every_m: float) -> list[Landmark]:
    """Markers of known places along the row, two above each other, where photos show them."""
    found = []
    for x in np.arange(0.5, cameras.centers_in_world[:, 0].max(), every_m):
        for z in (1.0, 1.9):
            seen = np.flatnonzero(np.abs(cameras.centers_in_world[:, 0] - x) < 0.5)
            place = np.array([x, 0.5, z])
            xy_px, _ = cameras.project_each(seen, np.broadcast_to(place, (len(seen), 3)))
            found.append(Landmark(place, 0.002, seen, xy_px, np.full(len(seen), 0.1)))
    return found


def dense_covariance(cameras: Cameras, weights: Weights) -> FloatArray:
    """Covariances (p, p) by the whole inverse, nothing being held: zero along what nothing fixes."""
    normal = normal_equations(cameras, weights).reduced().toarray()
    sizes = np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal / np.outer(sizes, sizes), rcond=1e-11, hermitian=True)
    return np.asarray(inverse / np.outer(sizes, sizes))


def about_the_best(covariance_of_centers: FloatArray, cameras: Cameras) -> FloatArray:
    """Standard deviations (n,) of centres about the similarity that fits them best, the whole matrix at once."""
    arms = cameras.centers_in_world - cameras.centers_in_world.mean(0)
    motions = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    motions += [*(np.cross(axis, arms) for axis in np.eye(3)), arms]
    gauge = np.array([motion.ravel() for motion in motions]).T
    weights = np.ones(len(gauge))
    for _ in range(4):
        fitted = np.eye(len(gauge)) - gauge @ np.linalg.pinv(gauge * weights[:, None]) * weights
        variances = np.diag(fitted @ covariance_of_centers @ fitted.T).reshape(-1, 3).sum(1)
        weights = np.repeat(1 / np.sqrt(np.maximum(variances, np.median(variances))), 3)
    return np.asarray(np.sqrt(variances))


def test_uncertainties_are_those_of_the_whole_inverse() -> None:
    cameras = photographed_along(14.0, 70)
    seeing, weights = weighted(cameras, noise_px=0.3, landmarks=marked(cameras, 6.0))
    wanted, found = dense_covariance(seeing, weights), covariance(seeing, weights)
    centers = (6 * np.arange(70)[:, None] + [3, 4, 5]).ravel()
    of_centers = wanted[np.ix_(centers, centers)]
    sds = np.sqrt(np.diag(of_centers).reshape(-1, 3).sum(1))
    assert found.center_sds == pytest.approx(sds, rel=1e-4)
    assert 1.3 < sds.max() / sds.min() < 10
    places = np.diag(wanted)[-3 * len(weights.known_idx) :].reshape(-1, 3)
    assert np.diagonal(found.known_points, axis1=1, axis2=2) == pytest.approx(places, rel=1e-4)
    arms = (cameras.centers_in_world - cameras.centers_in_world.mean(0)).ravel()
    assert found.scale_sd == pytest.approx(np.sqrt(arms @ of_centers @ arms) / (arms @ arms), rel=1e-4)
    assert focal_sds(seeing, weights)[0] == pytest.approx(np.sqrt(wanted[420, 420]), rel=1e-4)


def test_uncertainties_without_markers_are_those_about_the_best_similarity() -> None:
    cameras = photographed_along(14.0, 70)
    seeing, weights = weighted(cameras, noise_px=0.3, free_frames=np.zeros(70, np.int64))
    wanted = dense_covariance(seeing, weights)
    centers = (6 * np.arange(70)[:, None] + [3, 4, 5]).ravel()
    found = covariance(seeing, weights)
    assert found.center_sds == pytest.approx(about_the_best(wanted[np.ix_(centers, centers)], cameras), rel=1e-3)
    assert np.isnan(found.scale_sd)
    assert focal_sds(seeing, weights)[0] == pytest.approx(np.sqrt(wanted[420, 420]), rel=1e-3)


def test_a_row_that_mapping_has_bent_comes_out_straight() -> None:
    """With one factor for more and for less damping, 180 mm of a bow of 1 m were left after all steps."""
    row = photographed_along(15.0, 60)

    def off_mm(cameras: Cameras) -> float:
        nearest = estimate_similarity(cameras.centers_in_world, row.centers_in_world)
        return 1000 * float(
            np.linalg.norm(nearest.apply(cameras.centers_in_world) - row.centers_in_world, axis=1).max()
        )

    straight, bow = adjust(row, noise_px=0.3), bent(row, 1.0)
    assert 400 < off_mm(bow) < 1000
    assert 5 < off_mm(straight) < 80  # what noise does
    assert off_mm(adjust(bow, noise_px=0.3)) == pytest.approx(off_mm(straight), rel=0.1)


def test_a_photo_whose_points_nobody_else_sees_is_not_placed_by_them() -> None:
    cameras = photographed_along(4.0, 20)
    own = np.flatnonzero(cameras.track_photo_idx == 19)
    apart = cameras.track_point_idx.copy()
    apart[own] = len(cameras.points_in_world) + np.arange(len(own))
    places = np.concatenate([cameras.points_in_world, cameras.points_in_world[cameras.track_point_idx[own]]])
    alone = replace(
        cameras,
        points_in_world=places,
        points_rgb=np.zeros(places.shape, np.uint8),
        points_error_px=np.zeros(len(places)),
        track_point_idx=apart,
    )
    seeing, weights = weighted(alone, noise_px=0.3, landmarks=marked(cameras, 2.5))
    sds = covariance(seeing, weights).center_sds
    assert sds[:19].max() < 0.1
    assert sds[19] > 1


@pytest.mark.parametrize("border", [0, 2])
def test_parts_of_an_inverse_are_those_of_all_of_it(border: int) -> None:
    """Two chains that nothing connects, a node alone, and nodes that all others meet."""
    random, inner = np.random.default_rng(border), 61
    edges = [(i, j) for i in range(60) for j in (i + 1, i + 2) if j < 60 and (i < 30) == (j < 30)]
    edges += [(i, inner + k) for i in range(inner) for k in range(border)]
    nodes = np.repeat(np.arange(inner + border), 3)
    matrix = np.zeros((len(nodes), len(nodes)))
    for i, j in edges:
        rows = random.normal(size=(4, 6))
        both = np.concatenate([3 * i + np.arange(3), 3 * j + np.arange(3)])
        matrix[np.ix_(both, both)] += rows.T @ rows
    matrix += 0.1 * np.eye(len(matrix))
    inverse, found = np.linalg.inv(matrix), SelectedInverse(csr_array(matrix), nodes)
    params = np.arange(len(nodes)).reshape(-1, 3)
    assert found.blocks(params) == pytest.approx(np.array([inverse[np.ix_(mine, mine)] for mine in params]))
    right = random.normal(size=(len(nodes), 2))
    assert found.solve(right) == pytest.approx(inverse @ right)


def test_groups_are_where_labels_are() -> None:
    found = groups(np.array([3, 1, 3, 7, 1]))
    assert [(label, places.tolist()) for label, places in found] == [(1, [1, 4]), (3, [0, 2]), (7, [3])]
    assert groups(np.zeros(0, np.int64)) == []


def test_points_are_projected_into_their_own_photos_and_back() -> None:
    cameras, random = row_of_two_lenses(), np.random.default_rng(2)
    photo_idx = random.integers(0, len(cameras), 200)
    points = cameras.centers_in_world[photo_idx] + random.normal([0, 1, 0], [0.4, 0.8, 0.4], (200, 3))
    xy_px, depths = cameras.project_each(photo_idx, points)
    assert 10 < np.isnan(xy_px[:, 0]).sum() < 100
    for i, point, xy, depth in zip(photo_idx, points, xy_px, depths, strict=True):
        one_px, one_depth = cameras.project(int(i), point[None])
        assert xy == pytest.approx(one_px[0], nan_ok=True)
        assert depth == pytest.approx(one_depth[0])
    seen = np.isfinite(xy_px[:, 0])
    for i, xy, ray in zip(photo_idx[seen], xy_px[seen], cameras.rays_each(photo_idx[seen], xy_px[seen]), strict=True):
        assert ray == pytest.approx(cameras.rays_in_world(int(i), xy[None])[0], abs=1e-9)


def shares_by_all_photos(
    spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras, options: FilterOptions
) -> FloatArray:
    """`seen_shares` by asking every photo of every sphere."""
    result = np.ones(len(spheres))
    for i in range(len(spheres)):
        seen = photo_idx[sphere_idx == i]
        if not len(seen):
            continue
        sights = spheres.centers_in_world[i] - cameras.centers_in_world
        distances = np.linalg.norm(sights, axis=1)
        cosines = (sights / distances[:, None]) @ (sights[seen] / distances[seen, None]).T
        should = cosines.max(1) > np.cos(np.radians(options.near_deg))
        should &= distances < options.farther * distances[seen].max()
        for j in np.flatnonzero(should):
            lens = cameras.intrinsics_of(int(j))
            xy, depth = cameras.project(int(j), spheres.centers_in_world[i][None])
            margin = spheres.radii_m[i] * lens.focal_px / max(depth[0], 1e-9)
            should[j] = bool((xy > margin).all() and (xy < [lens.width_px - margin, lens.height_px - margin]).all())
        should[seen] = True
        result[i] = len(seen) / should.sum()
    return result


def test_photos_that_should_see_a_fruit_are_found_among_those_near_it() -> None:
    cameras, random, options = row_of_two_lenses(), np.random.default_rng(3), FilterOptions()
    count = 80
    centers = np.column_stack(
        [random.uniform(-4, 4, count), random.normal(0, 0.2, count), random.normal(0, 0.3, count)]
    )
    spheres = Spheres(centers, np.full(count, 0.035))
    pairs = []
    for i in range(1, count):  # the first is seen by none
        near = np.argsort(np.linalg.norm(cameras.centers_in_world - centers[i], axis=1))[:6]
        pairs += [(i, int(j)) for j in random.choice(near, random.integers(1, 5), replace=False)]
    sphere_idx, photo_idx = np.array(pairs).T
    found = seen_shares(spheres, sphere_idx, photo_idx, cameras, options)
    assert found == pytest.approx(shares_by_all_photos(spheres, sphere_idx, photo_idx, cameras, options))
    assert found[0] == 1
    assert 0.1 < found[1:].min() < found[1:].max() <= 1


def neighbours_of_all(cameras: Cameras, i: int, depth_m: float, options: DenseOptions) -> set[int]:
    """Photos that may be compared with photo i, by asking all."""
    lens, pose = cameras.intrinsics_of(i), cameras.cam_from_world[i]
    grid = (np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) + 0.5) / 5
    points = (lens.cam_from_px(grid * [lens.width_px, lens.height_px]) * depth_m - pose[:, 3]) @ pose[:, :3]
    sights = points.mean(0) - cameras.centers_in_world
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(sights @ sights[i], -1, 1)))
    found = set()
    for j in range(len(cameras)):
        xy, depth = cameras.project(j, points)
        size = [cameras.intrinsics_of(j).width_px, cameras.intrinsics_of(j).height_px]
        seen = (xy > 0).all(1) & (xy < size).all(1) & (depth > 0.6 * depth_m) & (depth < depth_m / 0.6)
        if (
            j != i
            and options.min_angle_deg <= angles[j] <= options.max_angle_deg
            and seen.mean() >= options.min_overlap
        ):
            found.add(j)
    return found


def test_photos_to_compare_are_found_among_those_near() -> None:
    cameras, options = row_of_two_lenses(), DenseOptions(neighbours=60)
    chosen = choose_neighbours(cameras, ("east",) * len(cameras), np.full(len(cameras), 1.5), options)
    wanted = [neighbours_of_all(cameras, i, 1.5, options) for i in range(len(cameras))]
    assert [set(found.tolist()) for found in chosen] == wanted
    assert 2 < np.mean([len(found) for found in wanted]) < 12


def seam_by_cutting_each_edge(
    inside: BoolArray, pairs: IntArray, explained: FloatArray, contradicted: FloatArray
) -> tuple[float, BoolArray | None]:
    """The worst seam by taking every edge of the tree out in turn, and how much it is contradicted."""
    best, seam, here = 0.0, None, inside[pairs].all(1)

    def graph(values: FloatArray, edges: IntArray) -> coo_matrix:
        return coo_matrix((values, edges.T), shape=(len(inside), len(inside)))

    found = minimum_spanning_tree(graph(2 * FULL_WEIGHT - explained[here], pairs[here])).tocoo()
    tree = np.stack([found.row, found.col], axis=1)
    for k in range(len(tree)):
        rest = np.delete(tree, k, axis=0)
        labels = connected_components(graph(np.ones(len(rest)), rest), directed=False)[1]
        side = (labels == labels[tree[k, 0]]) & inside
        across = here & (side[pairs[:, 0]] != side[pairs[:, 1]])
        excess = float(contradicted[across].sum() - explained[across].sum())
        if excess > best:
            best, seam = excess, side
    return best, seam


@pytest.mark.parametrize("seed", range(12))
def test_the_worst_seam_is_that_of_cutting_each_edge(seed: int) -> None:
    random, count = np.random.default_rng(seed), 40
    pairs = np.array([(i, i + step) for i in range(count) for step in (1, 2, 5, 19) if i + step < count])
    pairs = pairs[random.random(len(pairs)) < 0.7]
    explained, contradicted = random.uniform(0, 60, (2, len(pairs)))
    inside = random.random(count) < 0.9
    _, wanted = seam_by_cutting_each_edge(inside, pairs, explained, contradicted)
    found = worst_seam(inside, pairs, explained, contradicted)
    assert (found is None) == (wanted is None)
    if found is not None and wanted is not None:
        assert (found == wanted).all()
    assert worst_seam(inside, pairs, explained, 0 * contradicted) is None


def interval_by_all_fruits(fruits: Fruits, tree: int) -> tuple[int, int]:
    """A tree's 95 % interval by asking every fruit."""
    here, maybe = fruits.tree_ids == tree, fruits.other_tree_ids == tree
    share = np.where(here, np.where(fruits.other_tree_ids > 0, 0.5, 1.0), 0.0) + np.where(maybe & ~here, 0.5, 0.0)
    values = share * fruits.scores
    mean, sd = values.sum(), np.sqrt((values * (1 - values)).sum())
    high = min((here | maybe).sum(), int(np.ceil(mean + 1.96 * sd)))
    return max(min(here.sum(), int(np.floor(mean - 1.96 * sd))), 0), max(here.sum(), high)


def test_trees_have_the_intervals_of_their_own_fruits() -> None:
    random, count = np.random.default_rng(4), 400
    tree_ids = random.integers(0, 12, count)
    beside = np.where(random.random(count) < 0.3, tree_ids + 1, 0)
    fruits = Fruits(
        np.arange(1, count + 1),
        random.uniform(0, 12, (count, 3)),
        random.uniform(0.06, 0.08, count),
        random.uniform(0.3, 1, count),
        np.full(count, 3),
        tree_ids=tree_ids,
        other_tree_ids=beside,
    )
    trees = trees_of(fruits, Trunks(np.arange(1, 15), random.uniform(0, 12, (14, 2))), STORY_APPLES)
    assert trees.ids.tolist() == list(range(1, 15))
    assert trees.fruits.tolist() == [int((tree_ids == tree).sum()) for tree in range(1, 15)]
    intervals = [interval_by_all_fruits(fruits, tree) for tree in range(1, 15)]
    assert list(zip(trees.fruits_low.tolist(), trees.fruits_high.tolist(), strict=True)) == intervals


def test_the_first_of_two_trunks_at_one_place_is_named(tmp_path: Path) -> None:
    table = tmp_path / "trees.csv"
    table.write_text("id,x,y\n5,0,0\n6,1,0\n7,2,0\n8,1.004,0\n9,2,0.001\n")
    with pytest.raises(FormatError, match="trees 6 and 8 stand at the same place"):
        read_trunks(table)


def some_evidence(spheres: Spheres, cameras: Cameras) -> Evidence:
    """What photos of a row show, which is noise: only what is taken from it matters here."""
    random = np.random.default_rng(5)
    near = np.argsort(np.linalg.norm(spheres.centers_in_world[:, None] - cameras.centers_in_world, axis=2), axis=1)[
        :, :4
    ]
    sphere_idx = np.repeat(np.arange(len(spheres)), 4)
    sights = find_sights(spheres, sphere_idx, near.ravel(), cameras, SecondLookOptions())
    maps = random.uniform(0, 1, (len(sights.sphere_idx), 36, 36)).astype(np.float32)
    return Evidence(sights, 12 / sights.radii_px, maps, 2.0, Peaks.none(len(maps)))


def maps_by_all_fruits(
    evidence: Evidence, spheres: Spheres, seen: FloatArray, cameras: Cameras, options: SecondLookOptions, own: bool
) -> Float32Array:
    """What `unexplained` leaves of all maps, by asking every fruit in every photo."""
    sights, maps = evidence.sights, evidence.maps.copy()
    middles = np.arange(36) + 0.5 - 18
    for k, (sphere, photo) in enumerate(zip(sights.sphere_idx.tolist(), sights.photo_idx.tolist(), strict=True)):
        xy_px, depths = cameras.project(photo, spheres.centers_in_world)
        radii_px = images_px(cameras, photo, spheres)
        for i in np.flatnonzero((seen >= options.plain) & (depths > 0)).tolist():
            x, y = (xy_px[i] - sights.centers_px[k]) * evidence.scales[k] / evidence.cell_px
            if max(abs(x), abs(y)) >= 36 or (i == sphere and not own):
                continue
            width = options.peak_width * radii_px[i] * evidence.scales[k] / evidence.cell_px
            away2 = (middles - x) ** 2 + (middles[:, None] - y) ** 2
            maps[k] *= 1 - min(1, seen[i] / options.sure) * np.exp(-away2 / (2 * width**2))
    return maps


@pytest.mark.parametrize("own", [False, True])
def test_what_fruits_explain_is_found_among_those_near_a_photos_sights(
    own: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    lenses, random, options = row_of_two_lenses(), np.random.default_rng(6), SecondLookOptions()
    bent_lens = Intrinsics("SIMPLE_RADIAL", 320, 240, np.array([400.0, 160, 120, 0.25]))
    some = {name: getattr(lenses, name)[::4] for name in ("photos", "intrinsics_idx", "cam_from_world")}
    cameras = replace(lenses, intrinsics=(bent_lens, lenses.intrinsics[1]), **some)
    centers = np.column_stack([random.uniform(-20, 20, 250), random.uniform(-0.2, 2, 250), random.normal(0, 0.2, 250)])
    spheres, seen = Spheres(centers, random.uniform(0.03, 0.04, 250)), random.uniform(0, 0.6, 250)
    monkeypatch.setattr("pomona.stages.second_look.explained._BLOCK", 8)
    evidence = some_evidence(spheres, cameras)
    wanted = maps_by_all_fruits(evidence, spheres, seen, cameras, options, own)
    asked, project = [], Cameras.project

    def counted(self: Cameras, photo_idx: int, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        asked.append(len(points_in_world))
        return project(self, photo_idx, points_in_world)

    monkeypatch.setattr(Cameras, "project", counted)
    left = unexplained(evidence, spheres, seen, cameras, options, own=own)
    assert 5 < np.mean(asked) < 0.6 * (seen >= options.plain).sum()
    assert left.maps is evidence.maps  # of a long row they are gigabytes
    found = evidence.maps.copy()
    left.peaks.take_from(found, np.arange(len(found)))
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    assert 0.2 < (np.abs(wanted - evidence.maps) > 0.05).any((1, 2)).mean() <= 1  # of sights, something is explained


def test_values_among_others_are_those_that_all_have() -> None:
    random = np.random.default_rng(7)
    values, others = random.integers(-5, 40, 60), np.unique(random.integers(0, 30, 12))
    assert (among(values, others) == np.isin(values, others)).all()
    assert 0 < among(values, others).sum() < 60
    assert not among(values, np.zeros(0, np.int64)).any()


def touched_from_all_sides(count: int) -> tuple[Spheroids, SpheroidEvidence]:
    """Bodies side by side, rays that pass near each of them from five places, and points on every third."""
    random, radius = np.random.default_rng(8), 0.035
    centers = np.column_stack([np.arange(count) * 0.06, random.normal(0, 0.02, count), random.normal(0, 0.02, count)])
    bodies = Spheroids(
        centers, random.uniform(0.9, 1.1, count) * radius, np.ones(count), np.zeros((count, 2)), np.eye(3)
    )
    of = np.repeat(np.arange(count), 5)
    eyes = centers[of] + np.tile(
        [[-0.6, -2, 0], [-0.3, -2, 0.1], [0, -2, 0], [0.3, -2, -0.1], [0.6, -2, 0]], (count, 1)
    )
    turns = random.uniform(0, 2 * np.pi, (len(of), 8))
    off = radius * np.stack([np.cos(turns), np.zeros(turns.shape), np.sin(turns)], axis=2)
    rays = centers[of, None] + off - eyes[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    rays[(of % 3 == 0) & (np.arange(len(of)) % 5 == 0)] = 0
    places = np.where((rays == 0).all(2, keepdims=True), centers[of, None] + off, eyes[:, None])
    noise = np.full(len(of), 0.02 * radius)
    weights, nothing = np.full(turns.shape, 0.4), np.zeros(turns.shape)
    return bodies, SpheroidEvidence(of, places, rays, weights, noise, np.ones(len(of)), nothing)


def test_fruits_are_fitted_in_parts_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    bodies, evidence = touched_from_all_sides(23)
    prior = SpheroidPrior(radius_m=0.035, radius_sd=0.3, ratio=1.0, ratio_sd=0.1, tilt_sd=0.3, place_radii=1.0)
    found, edges, sizes = [], [], []
    distances = Spheroids.distances

    def watched(self: Spheroids, eyes: FloatArray, rays: FloatArray, of: IntArray) -> tuple[FloatArray, FloatArray]:
        sizes[-1] = max(sizes[-1], len(of))
        return distances(self, eyes, rays, of)

    monkeypatch.setattr(Spheroids, "distances", watched)
    for together in (1000, 5):
        monkeypatch.setattr("pomona.stages.measure.spheroid_fit._TOGETHER", together)
        monkeypatch.setattr("pomona.stages.measure.neighbours._TOGETHER", together)
        sizes.append(0)
        edges.append(edges_of_others(bodies, evidence))
        found.append(fit_spheroids(bodies, replace(evidence, others=edges[-1]), prior))
    assert sizes[1] < 0.3 * sizes[0]
    np.testing.assert_allclose(edges[1], edges[0])
    assert 0.1 < (edges[0] > 0).mean() < 0.9
    for name in ("covariances", "own_sds", "distances_m", "touching"):
        np.testing.assert_allclose(getattr(found[1], name), getattr(found[0], name), rtol=1e-9, atol=1e-12)
    for name in ("centers", "radii", "ratios", "tilts"):
        a, b = (getattr(fitted.spheroids, name) for fitted in found)
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-12)
    assert 1e-5 < np.abs(found[0].spheroids.centers - bodies.centers).max() < 0.03


def encounters_by_all_photos(
    fruits: Fruits, observations: Observations, cameras: Cameras
) -> tuple[BoolArray, BoolArray]:
    """Which photo saw which fruit (n, p), and which could have, by asking every photo for every fruit."""
    places, eyes = fruits.centers_in_world, cameras.centers_in_world
    seen = np.zeros((len(fruits), len(cameras)), bool)
    for fruit_id, photo in zip(observations.fruit_id.tolist(), observations.photo, strict=True):
        seen[fruit_id - 1, cameras.photos.index(photo)] = True
    away = np.linalg.norm(places[:, None] - eyes, axis=2)
    could = away < 1.5 * np.median(away[seen])
    for j in range(len(cameras)):
        xy_px, _ = cameras.project(j, places)
        could[:, j] &= ((xy_px > 0) & (xy_px < [320, 240])).all(1)
    return seen, could | seen


def test_photos_that_could_have_seen_a_fruit_are_found_among_those_near_it() -> None:
    cameras, random, count = row_of_two_lenses(), np.random.default_rng(9), 120
    centers = np.column_stack(
        [random.uniform(-5, 5, count), random.normal(0, 0.3, count), random.normal(0, 0.4, count)]
    )
    away = np.linalg.norm(centers[:, None] - cameras.centers_in_world, axis=2)
    fruit_idx, photo_idx = np.nonzero((away < 1.7) & (random.random(away.shape) < 0.4))
    again = np.arange(len(fruit_idx)) % 7 == 0  # two masks of one fruit in one photo count once
    fruit_idx, photo_idx = (np.concatenate([idx, idx[again]]) for idx in (fruit_idx, photo_idx))
    names = tuple(cameras.photos[j] for j in photo_idx)
    observations = Observations(fruit_idx + 1, names, np.arange(len(names)), np.zeros((len(names), 2)))
    views = np.bincount(fruit_idx, minlength=count)
    fruits = Fruits(np.arange(1, count + 1), centers, np.full(count, 0.07), np.full(count, 0.9), views)
    seen, could = encounters_by_all_photos(fruits, observations, cameras)
    found = encounters_of(fruits, observations, cameras, options=YieldOptions(most_photos=1000))
    assert found.seen.tolist() == seen.sum(1)[:, None].tolist()
    assert found.photos.tolist() == could.sum(1)[:, None].tolist()
    assert 1 < found.seen.mean() < found.photos.mean() < 0.3 * len(cameras)
